//! docs/paper.md is true: every file and test that it names exists, and every numbered item of the paper has its line.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../..")
}

fn page() -> String {
    fs::read_to_string(root().join("docs/paper.md")).expect("docs/paper.md")
}

/// All source files below the folder, by name.
fn sources() -> BTreeMap<String, String> {
    let mut found = BTreeMap::new();
    let mut open = vec![root().join("crates")];
    while let Some(folder) = open.pop() {
        for entry in folder.read_dir().expect("a folder").flatten() {
            let path = entry.path();
            if path.is_dir() {
                if path.file_name().is_some_and(|n| n != "target") {
                    open.push(path);
                }
            } else if path.extension().is_some_and(|e| e == "rs") {
                let name = path.to_string_lossy().replace('\\', "/");
                found.insert(name, fs::read_to_string(&path).expect("text"));
            }
        }
    }
    found
}

/// The rows of all tables: item, code, test.
fn rows(page: &str) -> Vec<[String; 3]> {
    page.lines()
        .filter(|l| l.starts_with("| ") && !l.starts_with("| item"))
        .map(|l| {
            let cells: Vec<&str> = l.trim_matches('|').split(" | ").map(str::trim).collect();
            assert_eq!(cells.len(), 3, "three cells: {l}");
            [0, 1, 2].map(|i| cells[i].to_string())
        })
        .collect()
}

fn quoted(cell: &str) -> Vec<&str> {
    cell.split('`').skip(1).step_by(2).collect()
}

/// The files that a name can mean.
fn files<'a>(sources: &'a BTreeMap<String, String>, name: &str) -> Vec<&'a String> {
    let end = format!("/{name}");
    sources
        .iter()
        .filter(|(path, _)| path.ends_with(&end))
        .map(|(_, text)| text)
        .collect()
}

#[test]
fn every_file_that_it_names_exists() {
    let (page, sources) = (page(), sources());
    let mut checked = 0;
    for [item, code, _] in rows(&page) {
        for name in quoted(&code) {
            let file = name.split(" :: ").next().unwrap_or(name);
            if !file.ends_with(".rs") {
                continue;
            }
            let found = files(&sources, file);
            assert!(!found.is_empty(), "{item}: no file {file}");
            if let Some((_, what)) = name.split_once(" :: ") {
                let has = |t: &&String| t.contains(&format!("fn {what}"));
                assert!(found.iter().any(has), "{item}: no {what} in {file}");
            }
            checked += 1;
        }
    }
    assert!(checked > 20, "{checked}");
}

#[test]
fn every_test_that_it_names_exists() {
    let (page, sources) = (page(), sources());
    let mut checked = 0;
    for [item, _, tests] in rows(&page) {
        let mut file = "";
        let mut named = 0;
        for name in quoted(&tests) {
            let test = match name.split_once(" :: ") {
                Some((f, test)) => {
                    file = f;
                    Some(test)
                }
                None if name.ends_with(".rs") => {
                    file = name;
                    None
                }
                None => Some(name),
            };
            let found = files(&sources, file);
            assert!(!found.is_empty(), "{item}: no test file {file}");
            if let Some(test) = test {
                let head = format!("#[test]\nfn {test}()");
                let slow = format!("\nfn {test}()");
                let has = |t: &&String| {
                    t.contains(&head) || (t.contains(&slow) && t.contains("#[ignore = \"slow"))
                };
                assert!(found.iter().any(has), "{item}: no test {test} in {file}");
            }
            named += 1;
        }
        assert!(named > 0 || tests.starts_with("as "), "{item} has no test");
        checked += named;
    }
    assert!(checked > 30, "{checked}");
}

/// The numbers in brackets: (9)(10), (21)–(25).
fn equations(items: &str) -> Vec<usize> {
    let mut found = Vec::new();
    let mut range = false;
    let mut rest = items;
    while let Some((before, after)) = rest.split_once('(') {
        let Some((inner, tail)) = after.split_once(')') else {
            break;
        };
        if let Ok(n) = inner.parse::<usize>() {
            let from = match found.last() {
                Some(&last) if range && before.is_empty() => last + 1,
                _ => n,
            };
            found.extend(from..=n);
        }
        (range, rest) = match tail.strip_prefix('–') {
            Some(tail) => (true, tail),
            None => (false, tail),
        };
    }
    found
}

#[test]
fn every_numbered_item_of_the_paper_has_its_line() {
    assert_eq!(
        equations("(9)(10) both, (21)–(24)"),
        [9, 10, 21, 22, 23, 24]
    );
    let page = page();
    let items: String = rows(&page)
        .into_iter()
        .map(|[item, ..]| item + "\n")
        .collect();
    let named = equations(&items);
    // The paper numbers its equations from 1 to 37.
    for n in 1..=37 {
        assert!(named.contains(&n), "({n}) has no line");
    }
    for item in [
        "Assumption 1",
        "Theorem 1",
        "Theorem 2",
        "Theorem 3",
        "Theorem 4",
        "Remark 1",
        "Remark 2",
        "Table 1",
        "Table 2",
        "Figure 1",
        "Figure 2",
        "Figure 3",
    ] {
        assert!(items.contains(item), "{item} has no line");
    }
}
