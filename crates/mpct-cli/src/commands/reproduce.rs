//! `mpct reproduce`: section 4 as one page and as data.

use crate::arguments::Reproduce;
use crate::failure::{Class, Failure};
use crate::output::{OutputFile, Waiting, print};
use crate::report::{Format, reproduction_figures, reproduction_page};
use mpct::analysis::reproduce::{Extent, Reproduction, ReproductionError, reproduce};
use std::fmt::Write;

pub fn run(arguments: &Reproduce) -> Result<(), Failure> {
    let folder = &arguments.out;
    std::fs::create_dir_all(folder).map_err(|e| Failure::io("make the folder", folder, &e))?;
    let open = |name: &str| OutputFile::open(&folder.join(name));
    // All places are tried before minutes of work.
    let (page, data) = (open("section-4.html")?, open("section-4.json")?);
    let (first, second) = (open("table-1.csv")?, open("table-2.csv")?);
    let extent = match (arguments.short, arguments.full) {
        (true, _) => Extent::Short,
        (_, true) => Extent::Full,
        _ => Extent::Standard,
    };
    let result = {
        let waiting = Waiting::new("section 4", None);
        reproduce(extent, &|what| waiting.at(0, what.to_string()))
    };
    let result = result.map_err(failure)?;
    let machine = machine();
    let json = serde_json::to_value(&result)
        .map(|mut value| {
            if let Some(object) = value.as_object_mut() {
                object.insert("machine".into(), machine.clone().into());
                object.insert("version".into(), env!("CARGO_PKG_VERSION").into());
            }
            value
        })
        .and_then(|value| serde_json::to_string_pretty(&value))
        .map_err(|e| Failure::new(Class::Io, format!("cannot write JSON: {e}")))?;
    let mut text = String::new();
    let mut written = vec![
        (
            "page",
            page.write(reproduction_page(&result, &machine).as_bytes())?,
        ),
        ("data", data.write(json.as_bytes())?),
        ("table 1", first.write(table_1(&result).as_bytes())?),
        ("table 2", second.write(table_2(&result).as_bytes())?),
    ];
    if arguments.png {
        for drawn in reproduction_figures(&result) {
            let bytes = Format::Png
                .encode(&drawn.svg)
                .map_err(|m| Failure::new(Class::Io, format!("cannot draw {}: {m}", drawn.name)))?;
            let file = open(&format!("{}.png", drawn.name))?;
            written.push(("picture", file.write(&bytes)?));
        }
    }
    for (what, path) in written {
        let _ = writeln!(text, "  {what:<8} {}", path.display());
    }
    print(&text)
}

fn failure(error: ReproductionError) -> Failure {
    match error {
        ReproductionError::Design(e) => e.into(),
        ReproductionError::Simulation(e) => e.into(),
        ReproductionError::Step(e) => e.into(),
        other => Failure::new(Class::Solver, other.to_string()),
    }
}

/// The machine, as far as it says.
fn machine() -> String {
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

fn table_1(r: &Reproduction) -> String {
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

fn table_2(r: &Reproduction) -> String {
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
