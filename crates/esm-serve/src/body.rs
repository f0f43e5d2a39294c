//! Request bodies: taken in within limits, then made a cloud.

use std::sync::Arc;

use axum::body::{Body, Bytes};
use axum::http::{HeaderMap, StatusCode, header};
use esm_io::{CloudMessage, Scan, ScanFormat, scan_from_bytes, scan_from_points};
use http_body_util::BodyExt;
use serde::Deserialize;
use tokio::sync::{OwnedSemaphorePermit, Semaphore};

use crate::problem::Problem;

/// What the bodies of all requests may take of the memory together, in steps of [`STEP`].
#[derive(Clone)]
pub(crate) struct Budget(Arc<Semaphore>);

/// Bytes that one permit stands for: small enough for small clouds, and a u32 of them counts terabytes.
const STEP: usize = 4096;

/// Some of the budget, given back when dropped.
#[derive(Default)]
pub(crate) struct Held(Option<OwnedSemaphorePermit>);

impl Budget {
    pub(crate) fn new(bytes: usize) -> Self {
        Self(Arc::new(Semaphore::new(bytes.div_ceil(STEP).min(Semaphore::MAX_PERMITS))))
    }

    /// Makes `held` stand for `bytes` in all; false where that much is not free.
    pub(crate) fn grow(&self, held: &mut Held, bytes: usize) -> bool {
        let now = held.0.as_ref().map_or(0, |h| h.num_permits());
        let Ok(more) = u32::try_from(bytes.div_ceil(STEP).saturating_sub(now)) else { return false };
        if more == 0 {
            return true;
        }
        let Ok(permit) = Arc::clone(&self.0).try_acquire_many_owned(more) else { return false };
        match &mut held.0 {
            Some(held) => held.merge(permit),
            None => held.0 = Some(permit),
        }
        true
    }
}

/// A body that has come whole.
pub(crate) struct Received {
    pub(crate) bytes: Vec<u8>,
    /// To be kept as long as the bytes are.
    pub(crate) held: Held,
}

/// Takes in a body of at most `limit` bytes. What a header declares is only believed to refuse; memory is taken as bytes
/// come.
pub(crate) async fn receive(
    headers: &HeaderMap,
    mut body: Body,
    limit: usize,
    budget: &Budget,
) -> Result<Received, Problem> {
    let too_large = |size: String| {
        let what = format!("the body has {size} bytes, at most {limit} are taken");
        Problem::new(StatusCode::PAYLOAD_TOO_LARGE, what, "thin the cloud, or raise --max-body-mb")
    };
    if let Some(encoding) = headers.get(header::CONTENT_ENCODING)
        && !encoding.as_bytes().eq_ignore_ascii_case(b"identity")
    {
        let what = "compressed bodies are not taken";
        return Err(Problem::new(StatusCode::UNSUPPORTED_MEDIA_TYPE, what, "send the body as it is"));
    }
    let declared = headers.get(header::CONTENT_LENGTH).and_then(|v| v.to_str().ok()?.parse::<u64>().ok());
    if let Some(declared) = declared.filter(|&n| n > limit as u64) {
        return Err(too_large(declared.to_string()));
    }
    let (mut bytes, mut held) = (Vec::new(), Held::default());
    while let Some(frame) = body.frame().await {
        let frame = frame.map_err(|e| {
            let what = format!("the body ended before it was whole: {e}");
            Problem::new(StatusCode::BAD_REQUEST, what, "send as many bytes as Content-Length says")
        })?;
        let Ok(data): Result<Bytes, _> = frame.into_data() else { continue };
        if data.len() > limit - bytes.len() {
            return Err(too_large(format!("more than {limit}")));
        }
        // A vector that grows has room for twice what it holds at most.
        if !budget.grow(&mut held, 2 * (bytes.len() + data.len())) {
            let what = "the bodies of other requests take all the memory there is for them";
            return Err(Problem::busy(what, "try again in a moment"));
        }
        bytes.extend_from_slice(&data);
    }
    Ok(Received { bytes, held })
}

/// What kind of body it is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Kind {
    /// Little-endian f32 x y z reflectance.
    Floats,
    /// One PointCloud2 in CDR.
    Cdr,
    /// A PCD file.
    Pcd,
    /// `{"stamp": s, "points": [[x, y, z], ...]}`.
    Json,
}

/// The kinds by their content types.
pub(crate) const KINDS: [(&str, Kind); 4] = [
    ("application/octet-stream", Kind::Floats),
    ("application/x-ros2-cdr", Kind::Cdr),
    ("application/x-pcd", Kind::Pcd),
    ("application/json", Kind::Json),
];

impl Kind {
    /// The kind that the headers name; parameters such as `charset` change nothing.
    pub(crate) fn of(headers: &HeaderMap) -> Result<Self, Problem> {
        let value = headers.get(header::CONTENT_TYPE).map(|v| v.as_bytes()).unwrap_or_default();
        let essence = value.split(|&b| b == b';').next().unwrap_or_default().trim_ascii();
        let kind = KINDS.iter().find(|(name, _)| name.as_bytes().eq_ignore_ascii_case(essence));
        kind.map(|(_, kind)| *kind).ok_or_else(|| {
            let what = match value {
                [] => "the content type is missing".to_owned(),
                other => format!("the content type '{}' is not known", other.escape_ascii()),
            };
            let names = KINDS.map(|(name, _)| name).join(", ");
            Problem::new(StatusCode::UNSUPPORTED_MEDIA_TYPE, what, format!("known are {names}"))
        })
    }

    /// Reads the cloud and the time it tells, if it does. Not for threads that talk.
    pub(crate) fn parse(self, bytes: &[u8], limit: usize) -> Result<(Scan, Option<f64>), Problem> {
        let bad = |e: esm_io::Error| Problem::of(StatusCode::BAD_REQUEST, &e);
        match self {
            Self::Floats => {
                Ok((scan_from_bytes(bytes, ScanFormat::Bin, "body", limit as u64).map_err(bad)?, None))
            }
            Self::Pcd => {
                Ok((scan_from_bytes(bytes, ScanFormat::Pcd, "body", limit as u64).map_err(bad)?, None))
            }
            Self::Cdr => {
                let message = CloudMessage::from_cdr(bytes, "body").map_err(bad)?;
                let stamp = message.stamp();
                Ok((message.scan, Some(stamp)))
            }
            Self::Json => {
                let cloud: JsonCloud = serde_json::from_slice(bytes).map_err(|e| {
                    let hint = "send {\"stamp\": seconds, \"points\": [[x, y, z], ...]}";
                    Problem::new(StatusCode::BAD_REQUEST, format!("body: {e}"), hint)
                })?;
                if cloud.stamp.is_some_and(|s| !s.is_finite()) {
                    let what = "body: the stamp is no number";
                    return Err(Problem::new(StatusCode::BAD_REQUEST, what, "send seconds"));
                }
                Ok((scan_from_points(cloud.points.into_iter().map(|p| p.0.map(f64::from))), cloud.stamp))
            }
        }
    }
}

/// A cloud as JSON.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct JsonCloud {
    stamp: Option<f64>,
    points: Vec<JsonPoint>,
}

/// Three or four numbers, of which the fourth, the reflectance, is not used.
struct JsonPoint([f32; 3]);

impl<'de> Deserialize<'de> for JsonPoint {
    fn deserialize<D: serde::Deserializer<'de>>(from: D) -> Result<Self, D::Error> {
        struct Numbers;
        impl<'de> serde::de::Visitor<'de> for Numbers {
            type Value = JsonPoint;

            fn expecting(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
                f.write_str("three or four numbers [x, y, z, reflectance]")
            }

            fn visit_seq<A: serde::de::SeqAccess<'de>>(self, mut seq: A) -> Result<JsonPoint, A::Error> {
                let mut point = [0.0f32; 3];
                for (i, value) in point.iter_mut().enumerate() {
                    // What is no number is a ray that did not come back.
                    let next = seq.next_element::<Option<f64>>()?;
                    let next = next.ok_or_else(|| serde::de::Error::invalid_length(i, &self))?;
                    *value = next.map_or(f32::NAN, |v| v as f32);
                }
                let mut numbers = 3;
                while seq.next_element::<Option<f64>>()?.is_some() {
                    numbers += 1;
                    if numbers > 4 {
                        return Err(serde::de::Error::invalid_length(numbers, &self));
                    }
                }
                Ok(JsonPoint(point))
            }
        }
        from.deserialize_seq(Numbers)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn kind(value: &str) -> Result<Kind, Problem> {
        let mut headers = HeaderMap::new();
        headers.insert(header::CONTENT_TYPE, value.parse().unwrap());
        Kind::of(&headers)
    }

    #[test]
    fn content_types_are_told_apart() {
        assert_eq!(kind("application/json; charset=utf-8"), Ok(Kind::Json));
        assert_eq!(kind("Application/X-PCD"), Ok(Kind::Pcd));
        assert_eq!(kind("text/plain").unwrap_err().status, 415);
        assert!(Kind::of(&HeaderMap::new()).unwrap_err().detail.contains("missing"));
    }

    #[test]
    fn json_clouds_are_read_and_nothing_else() {
        let parse = |text: &str| Kind::Json.parse(text.as_bytes(), 1 << 20);
        let (scan, stamp) =
            parse(r#"{"stamp": 2.5, "points": [[1, 2, 3], [4, 5, 6, 0.5], [null, 0, 1]]}"#).unwrap();
        assert_eq!((scan.cloud.points(), scan.dropped), (&[[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]][..], 1));
        assert_eq!(stamp, Some(2.5));
        for bad in [
            "",
            "{}",
            "[]",
            r#"{"points": 7}"#,
            r#"{"points": [[1, 2]]}"#,
            r#"{"points": [[1, 2, 3, 4, 5]]}"#,
            r#"{"points": [[1, 2, "x"]]}"#,
            r#"{"points": [], "cloud": 1}"#,
            r#"{"points": [[1, 2, 3]"#,
        ] {
            assert_eq!(parse(bad).unwrap_err().status, 400, "{bad}");
        }
    }

    #[tokio::test]
    async fn bodies_are_bounded_alone_and_together() {
        let headers = HeaderMap::new();
        let budget = Budget::new(64 << 10);
        let take = |n: usize| receive(&headers, Body::from(vec![1; n]), 20_000, &budget);
        assert_eq!(take(20_001).await.err().unwrap().status, 413);
        let first = take(20_000).await.ok().unwrap();
        assert_eq!(first.bytes.len(), 20_000);
        assert_eq!(take(20_000).await.err().unwrap().status, 503);
        drop(first);
        assert!(take(20_000).await.is_ok());
    }
}
