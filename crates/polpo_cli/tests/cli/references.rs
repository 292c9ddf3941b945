//! `polpo simulate --references` as one types it: its exit codes, its table, its JSON.

use crate::common::{polpo, text};

#[test]
fn the_table_has_the_worst_line_first() {
    let output = polpo(&["simulate", "--references", "--only", "throw", "--only", "wheel"]);
    assert_eq!(output.status.code(), Some(0), "{}", text(&output.stderr));
    let table = text(&output.stdout);
    let lines: Vec<&str> = table.lines().collect();
    assert!(lines[0].starts_with("reference") && lines[0].ends_with("setting"), "{table}");
    assert_eq!(lines.last(), Some(&"6 references, 0 out of tolerance"));
    assert!(output.stderr.is_empty(), "progress is for terminals");
    // error and tolerance are the fourth and third last columns before the setting of one or more words, `60 Hz`.
    let shares: Vec<f64> = lines[1..7]
        .iter()
        .map(|line| {
            let words: Vec<&str> = line.split_whitespace().rev().collect();
            let number = |k: usize| words[k].parse::<f64>().expect("a number");
            number(3) / number(2)
        })
        .collect();
    // The digits printed are two.
    assert!(shares.windows(2).all(|w| w[0] > 0.85 * w[1]), "{shares:?}");
}

#[test]
fn a_line_out_of_its_tolerance_is_exit_code_1() {
    let output = polpo(&["simulate", "--references", "--only", "throw", "--scale-tolerances", "1e-6"]);
    assert_eq!(output.status.code(), Some(1));
    assert!(text(&output.stdout).contains("OUT OF TOLERANCE") && text(&output.stdout).ends_with("3 references, 3 out of tolerance\n"));
}

#[test]
fn json_parses() {
    let output = polpo(&["simulate", "--references", "--only", "throw", "--json", "-"]);
    assert_eq!(output.status.code(), Some(0));
    let lines: serde_json::Value = serde_json::from_slice(&output.stdout).expect("JSON and nothing else");
    let lines = lines.as_array().expect("a list");
    assert_eq!(lines.len(), 3);
    for line in lines {
        let number = |key: &str| line[key].as_f64().unwrap_or_else(|| panic!("{key} of {line}"));
        let error = (number("got") - number("exact")).abs() / number("exact").abs();
        assert!((error - number("relative_error")).abs() < 1e-12 && number("relative_error") <= number("tolerance"));
        assert_eq!(line["holds"], true);
        assert!(["name", "setting", "reason", "source"].iter().all(|key| line[key].as_str().is_some_and(|s| !s.is_empty())));
    }

    let file = std::env::temp_dir().join(format!("polpo_references_{}.json", std::process::id()));
    let output = polpo(&["simulate", "--references", "--only", "throw", "--json", file.to_str().expect("a plain path")]);
    let written = std::fs::read(&file).expect("it was written");
    std::fs::remove_file(&file).expect("it can go");
    assert_eq!(serde_json::from_slice::<serde_json::Value>(&written).expect("JSON").as_array().map(Vec::len), Some(3));
    assert!(text(&output.stdout).starts_with("reference"));
}

#[test]
fn what_cannot_be_done_is_exit_code_2() {
    let output = polpo(&["simulate", "--references", "--only", "perpetuum mobile"]);
    assert_eq!(output.status.code(), Some(2));
    assert!(text(&output.stderr).contains("no measurement's name contains `perpetuum mobile`"));
    assert_eq!(polpo(&["simulate"]).status.code(), Some(2));
    assert_eq!(polpo(&["simulate", "--references", "--only", "throw", "--scale-tolerances", "-1"]).status.code(), Some(2));
    let output = polpo(&["simulate", "--references", "--only", "throw", "--json", "/no/such/folder/file.json"]);
    assert_eq!(output.status.code(), Some(2));
    assert!(text(&output.stderr).contains("/no/such/folder/file.json"), "{}", text(&output.stderr));
}
