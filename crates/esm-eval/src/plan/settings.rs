//! Settings over settings.

use esm_core::Config;
use toml::{Table, Value};

/// The keys that a plan sets elsewhere.
const ELSEWHERE: [(&[&str], &str); 3] = [
    (&["descriptor"], "the method's `descriptor`"),
    (&["accumulate", "distance_m"], "the dataset's or the mode's `accumulate`"),
    (&["accumulate", "swathes"], "the dataset's `swathes`"),
];

/// The defaults with these tables over them, the last on top. Says what is wrong with a key.
pub(super) fn merged(tables: &[&Table]) -> Result<Config, String> {
    let mut all = Table::try_from(Config::default()).map_err(|e| e.to_string())?;
    for table in tables {
        for (key, place) in ELSEWHERE {
            if holds(table, key) {
                return Err(format!("config: `{}` is told by {place}", key.join(".")));
            }
        }
        overlay(&mut all, table);
    }
    all.try_into()
        .map_err(|e: toml::de::Error| format!("config: {}", e.message().trim_end().replace('\n', " ")))
}

fn holds(table: &Table, key: &[&str]) -> bool {
    match (key, key.first().and_then(|first| table.get(*first))) {
        ([_], found) => found.is_some(),
        ([_, rest @ ..], Some(Value::Table(inner))) => holds(inner, rest),
        _ => false,
    }
}

fn overlay(under: &mut Table, over: &Table) {
    for (key, value) in over {
        match (under.get_mut(key), value) {
            (Some(Value::Table(under)), Value::Table(over)) => overlay(under, over),
            _ => {
                under.insert(key.clone(), value.clone());
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn table(text: &str) -> Table {
        text.parse().unwrap()
    }

    #[test]
    fn the_last_table_wins_and_the_rest_stays() {
        let first = table("seed = 3\n[match]\nk = 5\nmin_quality = 0.25\n");
        let second = table("[match]\nk = 7\n[pose]\nmin_inliers = 6\n");
        let config = merged(&[&first, &second]).unwrap();
        assert_eq!((config.seed, config.matching.k, config.matching.min_quality), (3, 7, 0.25));
        assert_eq!(config.pose.min_inliers, 6);
        assert_eq!(config.segment, Config::default().segment);
        assert_eq!(merged(&[]).unwrap(), Config::default());
    }

    #[test]
    fn what_does_not_belong_is_named() {
        for (text, words) in [
            ("[match]\nkk = 5\n", "unknown field `kk`"),
            ("magic = 5\n", "unknown field `magic`"),
            ("descriptor = \"eigen\"\n", "`descriptor` is told by the method's"),
            ("[accumulate]\ndistance_m = 5.0\n", "`accumulate.distance_m` is told by"),
            ("[match]\nk = \"x\"\n", "invalid type"),
        ] {
            let error = merged(&[&table(text)]).unwrap_err();
            assert!(error.contains(words), "{error}");
        }
    }
}
