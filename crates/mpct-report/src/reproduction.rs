//! Section 4 of the paper as files: a page, all data, and the two tables.

use crate::paper::reproduction_page;
use mpct::analysis::reproduce::Reproduction;
use std::fmt::Write;

/// The files that a reproduction writes.
pub const REPRODUCTION_FILES: [&str; 4] = [
    "section-4.html",
    "section-4.json",
    "table-1.csv",
    "table-2.csv",
];

/// What each of [`REPRODUCTION_FILES`] is, and its text.
///
/// # Errors
/// A message when the data cannot be written as JSON.
pub fn reproduction_files(result: &Reproduction) -> Result<[(&'static str, String); 4], String> {
    let json =
        serde_json::to_string_pretty(result).map_err(|e| format!("cannot write JSON: {e}"))?;
    Ok([
        ("page", reproduction_page(result, &machine())),
        ("data", json),
        ("table 1", table_1(result)),
        ("table 2", table_2(result)),
    ])
}

/// The machine, as far as it says.
pub fn machine() -> String {
    let threads = std::thread::available_parallelism().map_or(1, usize::from);
    let model = std::fs::read_to_string("/proc/cpuinfo")
        .ok()
        .and_then(|t| {
            t.lines()
                .find_map(|l| l.strip_prefix("model name"))
                .map(|l| l.trim_start_matches([' ', '\t', ':']).to_string())
        })
        .unwrap_or_else(|| std::env::consts::ARCH.into());
    format!("{model}, {threads} threads, {}", std::env::consts::OS)
}

/// Table 1 as CSV.
pub fn table_1(r: &Reproduction) -> String {
    let mut text = String::from(
        "plant,scaling,terminal_horizon,printed_terminal_horizon,cumulative_cost,printed_cumulative_cost,steps\n",
    );
    for l in &r.table_1 {
        let _ = writeln!(
            text,
            "{},{},{},{},{},{},{}",
            l.plant,
            l.scaling,
            l.terminal_horizon,
            l.printed_horizon,
            l.cumulative_cost,
            l.printed_cost,
            l.steps
        );
    }
    text
}

/// Table 2 as CSV.
pub fn table_2(r: &Reproduction) -> String {
    let mut text = String::from(
        "carts,terminal_horizon,variables,implicit_rows,explicit_rows,implicit_offline_s,explicit_offline_s,implicit_online_s,explicit_online_s,steps_timed,printed_implicit_offline_s,printed_explicit_offline_s,printed_implicit_online_s,printed_explicit_online_s\n",
    );
    let cell = |v: Option<f64>| v.map_or(String::new(), |v| v.to_string());
    for l in &r.table_2 {
        let rows = l.explicit_rows.map_or(String::new(), |v| v.to_string());
        let printed: Vec<String> = l.printed.iter().map(|v| cell(*v)).collect();
        let _ = writeln!(
            text,
            "{},{},{},{},{rows},{},{},{},{},{},{}",
            l.carts,
            l.terminal_horizon,
            l.variables,
            l.implicit_rows,
            l.implicit_offline,
            cell(l.explicit_offline),
            l.implicit_online,
            cell(l.explicit_online),
            l.steps,
            printed.join(",")
        );
    }
    text
}
