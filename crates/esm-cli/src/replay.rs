//! `esm-cli replay`.

use std::time::Duration;

use anyhow::Context;
use esm_serve::{Answer, Frame, Session, SessionOptions};
use serde_json::{Value, json};
use tokio::sync::watch;
use tokio::time::{Instant, sleep_until, timeout};

use crate::args::{ReadArgs, ReplayArgs};
use crate::inputs::{Frames, check_distinct};
use crate::outcome::{Failure, Outcome};
use crate::output::Lines;
use crate::serve;

/// How long an answer may be on its way.
const PATIENCE: Duration = Duration::from_secs(60);
/// How long the service's last words may be on their way.
const LAST_WORDS: Duration = Duration::from_secs(2);
/// A longer pause in the recording is not waited for, seconds: a gap, or another recording.
const LONGEST_PAUSE_S: f64 = 10.0;

pub(crate) fn run(args: &ReplayArgs) -> anyhow::Result<Outcome> {
    check_distinct(&args.inputs)?;
    if !(0.0..=1e6).contains(&args.speed) {
        let what = format!("--speed {}: that is no speed", args.speed);
        return Err(Failure::new(
            what,
            "give 1 for the recorded speed, 2 for twice that, 0 for as fast as it goes",
        )
        .into());
    }
    let read = ReadArgs {
        poses: args.poses.clone(),
        frames: args.frames.clone(),
        cloud_topic: args.cloud_topic.clone(),
        odometry_topic: args.odometry_topic.clone(),
        ..ReadArgs::default()
    };
    let frames = Frames::open(&args.inputs, &read, "replaying")?;
    let options = SessionOptions {
        map: args.map.clone(),
        accumulate_m: args.accumulate,
        token: args.token_file.as_deref().map(serve::token).transpose()?,
        authority: args.ca.clone(),
    };
    let runtime = serve::runtime()?;
    let tally = runtime.block_on(stream(args, frames, &options))?;
    Ok(if tally.located > 0 { Outcome::Done } else { Outcome::NothingLocalized })
}

/// What came of it.
#[derive(Clone, Copy, Debug, Default)]
struct Tally {
    answered: u64,
    located: u64,
    dropped: u64,
}

impl Tally {
    /// Clouds about which all is known.
    fn settled(&self) -> u64 {
        self.answered + self.dropped
    }
}

async fn stream(args: &ReplayArgs, mut frames: Frames, options: &SessionOptions) -> anyhow::Result<Tally> {
    let Session { mut to, mut from } = Session::connect(&args.to, options).await?;
    let (tell, mut told) = watch::channel(Tally::default());
    let as_json = args.json;
    let answers = tokio::spawn(async move {
        let mut lines = Lines::new(true);
        if !as_json {
            lines.line(&header())?;
        }
        while let Some(answer) = from.next().await? {
            lines.line(&if as_json { answer.line.clone() } else { row(&answer)? })?;
            tell.send_modify(|t| {
                t.answered += 1;
                t.located += u64::from(answer.located);
                t.dropped = answer.dropped;
            });
        }
        Ok::<Lines, anyhow::Error>(lines)
    });
    let mut sent = 0;
    let mut clock: Option<(Instant, f64)> = None;
    // An error here may only be the consequence of what the service said before.
    let sending = async {
        while let Some(frame) = frames.next()? {
            let sweep = frame.sweep;
            if args.speed > 0.0 {
                clock = Some(due(clock, sweep.stamp, args.speed).await);
            }
            if let Some(pose_odom_sensor) = sweep.pose_odom_sensor {
                to.send(&Frame::Odometry { stamp_ns: sweep.stamp_ns, pose_odom_sensor }).await?;
            }
            let points = sweep.cloud.into_points();
            to.send(&Frame::Cloud { stamp_ns: sweep.stamp_ns, points }).await?;
            sent += 1;
            if args.speed == 0.0 {
                settled(&mut told, sent, &args.to).await?;
            }
        }
        settled(&mut told, sent, &args.to).await?;
        to.close().await?;
        anyhow::Ok(())
    };
    if let Err(error) = sending.await {
        drop(to);
        // What the service has said about it is on its way, and says more.
        if let Ok(joined) = timeout(LAST_WORDS, answers).await {
            joined.context("reading the answers")??;
        }
        return Err(error);
    }
    let joined = timeout(PATIENCE, answers).await.context("waiting for the session's end")?;
    let mut lines = joined.context("reading the answers")??;
    let t = *told.borrow();
    lines.line(&match args.json {
        true => {
            let (answered, located, dropped) = (t.answered, t.located, t.dropped);
            json!({"summary": {"clouds": sent, "answered": answered, "located": located, "dropped": dropped}})
                .to_string()
        }
        false => format!(
            "\n{sent} clouds sent, {} answered, {} located, {} dropped",
            t.answered, t.located, t.dropped
        ),
    })?;
    Ok(t)
}

/// Waits until it is time to send; gives the clock that later sweeps go by.
async fn due(clock: Option<(Instant, f64)>, stamp: f64, speed: f64) -> (Instant, f64) {
    let Some((at, first)) = clock else { return (Instant::now(), stamp) };
    let wait = (stamp - first) / speed;
    let due = at + Duration::from_secs_f64(wait.clamp(0.0, 1e9));
    if stamp < first || due > Instant::now() + Duration::from_secs_f64(LONGEST_PAUSE_S) {
        return (Instant::now(), stamp);
    }
    sleep_until(due).await;
    (at, first)
}

/// Waits until all that was sent is answered or dropped.
async fn settled(told: &mut watch::Receiver<Tally>, sent: u64, url: &str) -> anyhow::Result<()> {
    let what = match timeout(PATIENCE, told.wait_for(|t| t.settled() >= sent)).await {
        Ok(Ok(_)) => return Ok(()),
        Ok(Err(_)) => "the session ended before all was answered".to_owned(),
        Err(_) => format!("no answer came for {} s", PATIENCE.as_secs()),
    };
    Err(Failure::new(format!("{url}: {what}"), "the service's log tells more").into())
}

fn header() -> String {
    format!(
        "{:>20} {:<9} {:>11} {:>11} {:>8} {:>7} {:>7} {:>8} {:>7}",
        "stamp [s]", "verdict", "x [m]", "y [m]", "z [m]", "held[m]", "score", "ms", "dropped"
    )
}

/// A row of the table.
fn row(answer: &Answer) -> anyhow::Result<String> {
    let line: Value = serde_json::from_str(&answer.line).context("an answer is no JSON")?;
    let number = |v: &Value| v.as_f64().unwrap_or(f64::NAN);
    let place = match &line["pose"]["t"] {
        Value::Array(t) if t.len() == 3 => {
            format!("{:>11.2} {:>11.2} {:>8.2}", number(&t[0]), number(&t[1]), number(&t[2]))
        }
        _ => format!("{:>11} {:>11} {:>8}", "-", "-", "-"),
    };
    let mut row = format!(
        "{:>20.6} {:<9} {place} {:>7.1} {:>7.2} {:>8.1} {:>7}",
        number(&line["stamp"]),
        line["verdict"].as_str().unwrap_or("?"),
        number(&line["travel_m"]),
        number(&line["score"]),
        number(&line["timings_ms"]["total"]),
        answer.dropped,
    );
    for more in [&line["map"], &line["reason"]] {
        if let Some(text) = more.as_str() {
            row.push_str("  ");
            row.push_str(text);
        }
    }
    Ok(row)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rows_stand_under_their_heads() {
        let line = r#"{"stamp": 1.5, "verdict": "located", "pose": {"t": [1, 2, 3], "q": [0, 0, 0, 1]},
            "travel_m": 20.0, "score": 9.5, "timings_ms": {"total": 27.25}, "reason": null, "dropped": 3}"#;
        let answer = Answer { line: line.to_owned(), dropped: 3, located: true };
        let row = row(&answer).unwrap();
        assert_eq!(row.chars().count(), header().chars().count());
        assert!(row.contains("located") && row.ends_with(" 3"), "{row}");
    }

    #[tokio::test(start_paused = true)]
    async fn sweeps_are_sent_at_the_recorded_pace_or_faster() {
        let begin = Instant::now();
        let mut clock = None;
        for stamp in [100.0, 100.5, 101.0] {
            clock = Some(due(clock, stamp, 2.0).await);
        }
        assert_eq!(begin.elapsed(), Duration::from_millis(500));
        // A gap, and a clock that was set back, are not waited for.
        clock = Some(due(clock, 5000.0, 2.0).await);
        clock = Some(due(clock, 1.0, 2.0).await);
        assert_eq!(begin.elapsed(), Duration::from_millis(500));
        due(clock, 2.0, 2.0).await;
        assert_eq!(begin.elapsed(), Duration::from_millis(1000));
    }
}
