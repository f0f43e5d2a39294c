//! Everything that is linked may be used, changed and given away, in closed products too.

use std::collections::HashSet;
use std::process::Command;

use serde_json::Value;

/// Licences whose only duties are to keep notices. (MPL, LGPL and GPL are not among them.)
const FREE: &[&str] = &[
    "MIT",
    "Apache-2.0",
    "Apache-2.0 WITH LLVM-exception",
    "BSD-2-Clause",
    "BSD-3-Clause",
    "BSL-1.0",
    "ISC",
    "Zlib",
    "0BSD",
    "Unlicense",
    "CC0-1.0",
    "Unicode-3.0",
];

/// Tools that only write a file for us: allowed under any open licence, and linked into nothing but tests.
const TOOLS: &[&str] = &["cbindgen"];

/// Whether an SPDX expression can be satisfied with [`FREE`] licences. `/` is an old way to write OR.
fn is_free(expression: &str) -> bool {
    let spaced =
        expression.replace('/', " OR ").replace('(', " ( ").replace(')', " ) ").replace(" WITH ", "~");
    let words: Vec<&str> = spaced.split_whitespace().collect();
    let mut at = 0;
    let free = any(&words, &mut at);
    free && at == words.len()
}

fn any(words: &[&str], at: &mut usize) -> bool {
    let mut free = all(words, at);
    while words.get(*at) == Some(&"OR") {
        *at += 1;
        free |= all(words, at);
    }
    free
}

fn all(words: &[&str], at: &mut usize) -> bool {
    let mut free = one(words, at);
    while words.get(*at) == Some(&"AND") {
        *at += 1;
        free &= one(words, at);
    }
    free
}

fn one(words: &[&str], at: &mut usize) -> bool {
    let Some(word) = words.get(*at) else { return false };
    *at += 1;
    if *word != "(" {
        return FREE.contains(&word.replace('~', " WITH ").as_str());
    }
    let free = any(words, at);
    let closed = words.get(*at) == Some(&")");
    *at += 1;
    free && closed
}

#[test]
fn licence_expressions_are_understood() {
    for good in [
        "MIT",
        "MIT/Apache-2.0",
        "GPL-3.0 OR MIT",
        "(MIT OR GPL-3.0) AND Unicode-3.0",
        "Apache-2.0 WITH LLVM-exception",
    ] {
        assert!(is_free(good), "{good}");
    }
    for bad in
        ["GPL-3.0", "MIT AND GPL-3.0", "(MIT", "", "MIT MIT", "MPL-2.0", "(GPL-3.0 OR LGPL-2.1) AND MIT"]
    {
        assert!(!is_free(bad), "{bad}");
    }
}

#[test]
fn every_dependency_has_a_free_licence() {
    let output = Command::new(env!("CARGO"))
        .args([
            "metadata",
            "--format-version",
            "1",
            "--locked",
            "--filter-platform",
            "x86_64-unknown-linux-gnu",
        ])
        .current_dir(env!("CARGO_MANIFEST_DIR"))
        .output()
        .expect("cargo runs");
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let metadata: Value = serde_json::from_slice(&output.stdout).unwrap();
    let used: HashSet<&str> =
        metadata["resolve"]["nodes"].as_array().unwrap().iter().filter_map(|n| n["id"].as_str()).collect();
    let packages = metadata["packages"].as_array().unwrap();
    let used: Vec<&Value> =
        packages.iter().filter(|p| used.contains(p["id"].as_str().unwrap_or_default())).collect();
    assert!(used.len() > 50, "{} packages are too few to be all", used.len());
    let bad: Vec<String> = used
        .iter()
        .filter(|p| !is_free(p["license"].as_str().unwrap_or_default()))
        .filter(|p| !TOOLS.contains(&p["name"].as_str().unwrap_or_default()))
        .map(|p| format!("{} {}: {}", p["name"], p["version"], p["license"]))
        .collect();
    assert!(bad.is_empty(), "{bad:#?}");
    for node in metadata["resolve"]["nodes"].as_array().unwrap() {
        for dep in node["deps"].as_array().unwrap() {
            let tool = TOOLS.contains(&dep["name"].as_str().unwrap_or_default());
            let linked = dep["dep_kinds"].as_array().unwrap().iter().any(|k| k["kind"] != "dev");
            assert!(!(tool && linked), "{} links {}", node["id"], dep["name"]);
        }
    }
}
