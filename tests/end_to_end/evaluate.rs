//! Evaluations: followed, kept, taken up again; and plans that cannot be followed.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use serde_json::Value;

use crate::common::{Ran, esm, folder, names, program};

/// The example that the repository brings.
fn small() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../evaluation/small.toml")
}

fn results(out: &Path) -> Value {
    serde_json::from_str(&fs::read_to_string(out.join("results.json")).unwrap()).unwrap()
}

/// The counts of one result.
fn counts<'a>(results: &'a Value, seed: u64, mode: &str, method: &str) -> &'a Value {
    let is = |r: &&Value| r["seed"] == seed && r["mode"] == mode && r["method"] == method;
    &results["results"].as_array().unwrap().iter().find(is).unwrap()["counts"]
}

/// What a run said it had done.
fn done(ran: &Ran) -> &str {
    let line = ran.stdout.lines().last().unwrap_or_default();
    line.split(';').next().unwrap_or_default()
}

#[test]
fn an_evaluation_is_what_the_commands_say_and_is_not_done_twice() {
    let dir = folder();
    let out = dir.path().join("out");
    let ran = esm!["evaluate", small(), "-o", out].ended(0);
    // Two worlds; two modes with two methods, one with one; two descriptors.
    assert_eq!(done(&ran), "14 results computed, 0 taken from an earlier run", "{}", ran.stdout);
    let files = [
        "places-street-100-eigenvalues.png",
        "places-street-100-shape.png",
        "report.md",
        "results.csv",
        "results.json",
        "roc-street-100.png",
        "roc-street-101.png",
    ];
    assert_eq!(names(&out), [&files[..], &["work"]].concat());
    let found = results(&out);
    let pooled = found["pooled"].as_array().unwrap();
    assert_eq!((pooled.len(), found["results"].as_array().unwrap().len()), (5, 10));
    let shape = &pooled[0];
    let number = |v: &Value| v.as_f64().unwrap_or_else(|| panic!("{v}"));
    assert_eq!((&shape["mode"], &shape["method"]), (&Value::from("single"), &Value::from("shape")));
    assert!(number(&shape["counts"]["recall"]) > 0.8 && shape["counts"]["false"] == 0, "{shape:#}");
    assert!(number(&shape["median_error_m"]) < 0.5 && number(&shape["p50_ms"]["total"]) > 0.1, "{shape:#}");
    assert!(shape["recall_over_seeds_95"].is_array() && number(&shape["peak_mib"]) > 1.0, "{shape:#}");
    for roc in found["roc"].as_array().unwrap() {
        assert!(number(&roc["random"]["auc"]) > 0.6, "{}: {}", roc["method"], roc["random"]["auc"]);
        assert!(roc["judged"].as_u64().unwrap() > 20 && roc["random_judged"].is_null());
    }
    let auc = |i: usize| number(&found["roc"][i]["random"]["auc"]);
    assert!(auc(0) > auc(1), "sizes tell more than eigenvalues alone: {} {}", auc(0), auc(1));
    let report = fs::read_to_string(out.join("report.md")).unwrap();
    for words in [
        "| dataset | clouds | localizable | shape |",
        "| judging | pose |",
        "no judgement",
        "](roc-street-101.png)",
    ] {
        assert!(report.contains(words), "'{words}' is missing in\n{report}");
    }
    the_commands_agree(&dir.path().join("check"), &out, &found);
    again(&out, &files, &found);
}

/// `map build` and `localize` on the recordings that were simulated.
fn the_commands_agree(check: &Path, out: &Path, found: &Value) {
    fs::create_dir(check).unwrap();
    let sims = out.join("work/simulated");
    let world = names(&sims).into_iter().find(|n| n.starts_with("kitti-101-")).unwrap();
    let file = |name: &str| sims.join(&world).join(name);
    let (map, config) = (check.join("map.esm"), check.join("esm.toml"));
    fs::write(&config, "[match]\nk = 200\n").unwrap();
    let build = ["--accumulate", "5", "--descriptor", "eigen"];
    let poses = file("map_truth.tum");
    let ran = esm![
        "map",
        "build",
        file("map.mcap"),
        "--poses",
        poses,
        build[0],
        build[1],
        build[2],
        build[3],
        "-o",
        map
    ];
    ran.ended(0);
    let truth = file("live_truth.tum");
    let ran = esm![
        "localize",
        "--json",
        "--single",
        "--map",
        map,
        file("live.mcap"),
        "--truth",
        truth,
        "--accumulate",
        "5",
        "--config",
        config,
        "--descriptor",
        "eigen"
    ];
    let lines = ran.json();
    let clouds: Vec<&Value> = lines.iter().filter(|l| l["stamp"].is_number()).step_by(2).collect();
    let c = counts(found, 101, "single", "eigenvalues");
    let located: Vec<&&Value> = clouds.iter().filter(|l| l["verdict"] == "located").collect();
    let right = located.iter().filter(|l| l["error_m"].as_f64().unwrap() <= 2.0).count();
    assert_eq!((&c["clouds"], &c["located"]), (&clouds.len().into(), &located.len().into()));
    assert_eq!((&c["correct"], &c["false"]), (&right.into(), &(located.len() - right).into()));
    let full = |l: &&&Value| l["localizable"] == true && l["travel_m"].as_f64().unwrap() >= 4.75;
    assert_eq!(c["localizable"], clouds.iter().filter(full).count());
}

/// A second run computes nothing and writes the same; one that finds a damaged result makes that one again.
fn again(out: &Path, files: &[&str], found: &Value) {
    let read = || files.iter().map(|f| fs::read(out.join(f)).unwrap()).collect::<Vec<_>>();
    let first = read();
    let ran = esm!["evaluate", small(), "-o", out].ended(0);
    assert_eq!(done(&ran), "0 results computed, 14 taken from an earlier run");
    for ((before, now), file) in first.iter().zip(read()).zip(files) {
        assert!(*before == now, "{file} has changed");
    }
    let ran =
        esm!["evaluate", small(), "-o", out, "--mode", "single", "--method", "shape", "--json"].ended(0);
    assert_eq!(counts(&ran.value(), 100, "single", "shape"), counts(found, 100, "single", "shape"));
    let kept = out.join("work/results");
    let is_trial = |name: &&String| {
        name.ends_with(".json") && fs::read_to_string(kept.join(name)).unwrap().contains("\"kind\":\"trial\"")
    };
    let torn = kept.join(names(&kept).iter().find(is_trial).unwrap());
    let whole = fs::read(&torn).unwrap();
    fs::write(&torn, &whole[..whole.len() / 2]).unwrap();
    // The map that it needs is damaged as well.
    for map in names(&kept).iter().filter(|n| n.ends_with(".esm")) {
        let mut bytes = fs::read(kept.join(map)).unwrap();
        let middle = bytes.len() / 2;
        bytes[middle] ^= 1;
        fs::write(kept.join(map), bytes).unwrap();
    }
    let ran = esm!["evaluate", small(), "-o", out].ended(0);
    assert_eq!(done(&ran), "1 results computed, 13 taken from an earlier run");
    assert!(ran.stderr.contains("warning: ") && ran.stderr.contains("a damaged result"), "{}", ran.stderr);
    let (before, now) = (found["results"].as_array().unwrap(), results(out));
    for (a, b) in before.iter().zip(now["results"].as_array().unwrap()) {
        assert_eq!((&a["counts"], &a["median_error_m"]), (&b["counts"], &b["median_error_m"]));
    }
}

#[cfg(unix)]
#[test]
fn an_interrupted_evaluation_goes_on_where_it_was() {
    let dir = folder();
    let plan = dir.path().join("plan.toml");
    let text = "[[datasets]]\nname = \"wood\"\npreset = \"train-forest\"\nseeds = [100]\nscale = 0.03\naccumulate = 8\n\
                config.match.k = 5\n[[methods]]\nname = \"eigen\"\n[[methods]]\nname = \"shape\"\n";
    fs::write(&plan, text).unwrap();
    let out = dir.path().join("out");
    let evaluate = || {
        let mut command = program();
        command.arg("evaluate").arg(&plan).arg("-o").arg(&out);
        command.stdout(Stdio::piped()).stderr(Stdio::piped());
        command
    };
    let kept = out.join("work/results");
    let results = || match kept.exists() {
        true => names(&kept).iter().filter(|n| n.ends_with(".json")).count(),
        false => 0,
    };
    let mut child = evaluate().spawn().unwrap();
    let started = Instant::now();
    // The first map and the first trial are there, the second method is in hand.
    while results() < 2 && started.elapsed() < Duration::from_secs(120) {
        std::thread::sleep(Duration::from_millis(2));
    }
    assert!(child.try_wait().unwrap().is_none());
    assert!(Command::new("kill").args(["-INT", &child.id().to_string()]).status().unwrap().success());
    let output = child.wait_with_output().unwrap();
    let stderr = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(130), "{stderr}");
    assert_eq!(stderr, "interrupted\nhint: the same command goes on where it was\n");
    let whole = |n: &String| !n.starts_with('.') && (n.ends_with(".json") || n.ends_with(".esm"));
    assert!(names(&kept).iter().all(whole), "{:?}", names(&kept));
    assert_eq!(names(&out), ["work"], "no half of a report");
    let output = evaluate().output().unwrap();
    let stdout = String::from_utf8_lossy(&output.stdout);
    assert!(output.status.success() && stdout.contains("\n1 results computed, 1 taken"), "{stdout}");
    assert!(names(&out).contains(&"report.md".to_owned()));
}

#[test]
fn plans_that_cannot_be_followed_are_refused_with_their_line() {
    let dir = folder();
    let plan = dir.path().join("plan.toml");
    let out = dir.path().join("out");
    let good = "[[datasets]]\nname = \"a\"\npreset = \"kitti\"\nseeds = [100]\nscale = 0.01\n[[methods]]\nname = \"shape\"\n";
    let run = |text: &str| {
        fs::write(&plan, text).unwrap();
        esm!["evaluate", plan, "-o", out]
    };
    for (from, to, words) in [
        ("scale", "scael", &["plan.toml:5: unknown field `scael`", "docs/evaluation.md"][..]),
        (
            "\"shape\"",
            "\"magic\"",
            &["plan.toml:7: method 'magic': there is no descriptor 'magic'", "esm-swift"],
        ),
        ("\"shape\"", "\"x\"\ndescriptor = \"x.safetensors\"", &["plan.toml:8: method 'x'", "x.safetensors"]),
        ("[[methods]]\nname = \"shape\"\n", "", &["plan.toml: there is no method", "[[methods]]"]),
        ("[[methods]]\nname = \"shape\"\n", "methods = []", &["plan.toml"]),
        (
            "preset = \"kitti\"\nseeds = [100]\nscale = 0.01",
            "map = \"no.mcap\"",
            &["plan.toml:3: dataset 'a', map: ", "no.mcap"],
        ),
        ("preset = \"kitti\"\n", "", &["plan.toml:2: dataset 'a': either `preset` or `map`"]),
        ("\"kitti\"", "\"moon\"", &["plan.toml:3: dataset 'a': no preset is called 'moon'", "burgess"]),
        ("[100]", "[100, 100]", &["plan.toml:2: dataset 'a': `seeds` must name each world once"]),
        ("0.01", "100.0", &["plan.toml:3: dataset 'a': the scale 100 is not within"]),
        (
            "\"shape\"",
            "\"shape\"\nconfig.match.kk = 1",
            &["plan.toml:7: method 'shape' on 'a': config: unknown field `kk`"],
        ),
        ("\"shape\"", "\"shape\"\nconfig.match.k = 99999", &["plan.toml:7", "match.k = 99999"]),
        (
            "\"shape\"",
            "\"shape\"\nconfig.descriptor = \"esf\"",
            &["plan.toml:7", "the method's `descriptor`"],
        ),
        ("\"shape\"", "\"shape\"\n[[modes]]\nname = \"m\"\nevery = 0", &["plan.toml:9: mode 'm': `every`"]),
        (
            "\"shape\"",
            "\"shape\"\n[[modes]]\nname = \"m\"\nmap_deleted = 1.0",
            &["plan.toml:9: mode 'm': map_deleted = 1"],
        ),
        (
            "\"shape\"",
            "\"shape\"\n[[modes]]\nname = \"m\"\nmethods = [\"y\"]",
            &["plan.toml:10: there is no method 'y'", "shape"],
        ),
        (
            "\"shape\"",
            "\"shape\"\n[[methods]]\nname = \"shape\"",
            &["plan.toml:9: method 'shape': there are two"],
        ),
        ("name = \"a\"", "name = \"a/../b\"", &["plan.toml:2: dataset \"a/../b\": this cannot be a name"]),
    ] {
        assert!(good.contains(from), "{from}");
        run(&good.replacen(from, to, 1)).failed(words);
        assert!(!out.exists(), "nothing was begun");
    }
    esm!["evaluate", dir.path().join("none.toml"), "-o", out].failed(&["none.toml", "opening the plan"]);
    run(good).ended(0);
    esm!["evaluate", plan, "-o", out, "--method", "eigen"]
        .failed(&["there is no method 'eigen'", "are shape"]);
    esm!["evaluate", plan, "-o", plan].failed(&["this is not a directory"]);
    // A recording that the mode cannot be run on.
    let burgess = good.replacen("\"kitti\"", "\"burgess\"", 1) + "[[modes]]\nname = \"thin\"\nbeams = 2\n";
    run(&burgess).failed(&["live.mcap", "of one laser", "mode 'thin'"]);
}
