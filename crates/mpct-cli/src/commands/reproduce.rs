//! `mpct reproduce`: section 4 as one page and as data.

use crate::arguments::Reproduce;
use crate::failure::{Class, Failure};
use crate::output::{OutputFile, Waiting, print};
use crate::report::reproduction_page;
use mpct::analysis::reproduce::{Extent, ReproductionError, reproduce};
use std::fmt::Write;

use crate::report::{machine, table_1, table_2};

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
    let json = serde_json::to_string_pretty(&result)
        .map_err(|e| Failure::new(Class::Io, format!("cannot write JSON: {e}")))?;
    let mut text = String::new();
    for (what, path) in [
        (
            "page",
            page.write(reproduction_page(&result, &machine()).as_bytes())?,
        ),
        ("data", data.write(json.as_bytes())?),
        ("table 1", first.write(table_1(&result).as_bytes())?),
        ("table 2", second.write(table_2(&result).as_bytes())?),
    ] {
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
