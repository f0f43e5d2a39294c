//! What the user sees: help, configuration, completions, manual pages, errors.

use crate::common::{esm, folder, names, run};

fn help(of: &[&str]) -> String {
    run(of.iter().copied().chain(["--help"])).ended(0).stdout
}

#[test]
fn help_texts() {
    insta::assert_snapshot!("help", help(&[]));
    insta::assert_snapshot!("help_map_build", help(&["map", "build"]));
    insta::assert_snapshot!("help_map_info", help(&["map", "info"]));
    insta::assert_snapshot!("help_localize", help(&["localize"]));
    insta::assert_snapshot!("help_loops", help(&["loops"]));
    let simulate = help(&["simulate"]);
    let (presets, rest): (Vec<&str>, Vec<&str>) =
        simulate.lines().partition(|l| l.starts_with("          - "));
    insta::assert_snapshot!("help_simulate", rest.join("\n"));
    assert!(presets.len() >= 6 && presets.iter().all(|l| l.len() > 40), "each says what it is: {presets:?}");
    insta::assert_snapshot!("help_demo", help(&["demo"]));
    insta::assert_snapshot!("help_evaluate", help(&["evaluate"]));
    insta::assert_snapshot!("help_serve", help(&["serve"]));
    insta::assert_snapshot!("help_replay", help(&["replay"]));
}

#[test]
fn errors_read_like_this() {
    let dir = folder();
    let plain =
        |ran: crate::common::Ran| ran.ended(2).stderr.replace(&dir.path().display().to_string(), "DIR");
    let missing = dir.path().join("missing.esm");
    insta::assert_snapshot!("error_missing_map", plain(esm!["map", "info", missing]));
    insta::assert_snapshot!(
        "error_unknown_extension",
        plain(esm!["map", "build", "x.mcap", "-o", dir.path().join("map.txt")])
    );
    let config = dir.path().join("esm.toml");
    std::fs::write(&config, "[verify]\nmin_seen = \"high\"\n").unwrap();
    insta::assert_snapshot!(
        "error_bad_configuration",
        plain(esm!["localize", "--map", missing, "x.mcap", "--config", config])
    );
    insta::assert_snapshot!(
        "error_bad_frames",
        plain(esm!["localize", "--map", "m", "x", "--frames", "9-3"])
    );
}

#[test]
fn the_configuration_is_complete_commented_toml() {
    let text = esm!["config"].ended(0).stdout;
    assert_eq!(toml::from_str::<esm_core::Config>(&text).unwrap(), esm_core::Config::default());
    assert!(text.lines().filter(|l| l.starts_with("# ")).count() > 30);
}

#[test]
fn completions_are_made_for_every_shell() {
    for shell in ["bash", "zsh", "fish", "elvish", "powershell"] {
        let script = esm!["completions", shell].ended(0).stdout;
        assert!(script.contains("localize") && script.contains("accumulate"), "{shell}");
        assert!(script.contains("simulate") && script.contains("demo"), "{shell}");
        // The scripts of the other shells do not complete the values of arguments that have no flag.
        assert!(script.contains("george-square") || !["bash", "zsh"].contains(&shell), "{shell}");
    }
    esm!["completions", "tcsh"].ended(2);
}

#[test]
fn manual_pages_are_written() {
    let page = esm!["man"].ended(0).stdout;
    assert!(
        page.contains(".TH esm-cli 1") && page.contains("Exit codes") && page.contains("SIGTERM"),
        "{page}"
    );
    let dir = folder();
    esm!["man", "-o", dir.path()].ended(0);
    assert_eq!(
        names(dir.path()),
        [
            "esm-cli-completions.1",
            "esm-cli-config.1",
            "esm-cli-demo.1",
            "esm-cli-evaluate.1",
            "esm-cli-localize.1",
            "esm-cli-loops.1",
            "esm-cli-man.1",
            "esm-cli-map-build.1",
            "esm-cli-map-info.1",
            "esm-cli-map.1",
            "esm-cli-replay.1",
            "esm-cli-segments.1",
            "esm-cli-serve.1",
            "esm-cli-simulate.1",
            "esm-cli.1",
        ]
    );
    let localize = std::fs::read_to_string(dir.path().join("esm-cli-localize.1")).unwrap();
    let title = localize.lines().find(|l| l.starts_with(".TH ")).unwrap();
    assert!(title.starts_with(".TH esm-cli-localize 1 ") && title.ends_with("\"esm-cli manual\""), "{title}");
    assert!(title.contains(concat!("\"esm-cli ", env!("CARGO_PKG_VERSION"), "\"")), "{title}");
}

#[test]
fn asking_for_help_is_no_error_and_asking_for_nothing_is() {
    assert!(esm!["--version"].ended(0).stdout.starts_with("esm-cli 0."));
    assert!(run([""; 0]).ended(2).stderr.contains("Usage: esm-cli"));
    assert!(esm!["locate"].ended(2).stderr.contains("localize"), "a slip is corrected");
    for (arguments, command) in [
        (&["locate"][..], "esm-cli"),
        (&["-v", "localize", "--magic"], "esm-cli localize"),
        (&["map", "build", "x"], "esm-cli map build"),
        (&["map", "look", "build"], "esm-cli map"),
    ] {
        let ran = run(arguments).ended(2);
        let hint = format!("\nhint: {command} --help lists all there is\n");
        assert!(ran.stderr.starts_with("error: ") && ran.stderr.ends_with(&hint), "{}", ran.stderr);
    }
}
