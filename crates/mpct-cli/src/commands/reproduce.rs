//! `mpct reproduce`: section 4 as one page and as data.

use crate::arguments::Reproduce;
use crate::failure::{Class, Failure};
use crate::output::{OutputFile, Waiting, print};
use mpct::analysis::reproduce::{Extent, ReproductionError, reproduce};
use mpct_report::{Format, REPRODUCTION_FILES, reproduction_figures, reproduction_files};
use std::fmt::Write;

pub fn run(arguments: &Reproduce) -> Result<(), Failure> {
    let folder = &arguments.out;
    std::fs::create_dir_all(folder).map_err(|e| Failure::io("make the folder", folder, &e))?;
    let open = |name: &str| OutputFile::open(&folder.join(name));
    // All places are tried before minutes of work.
    let places = REPRODUCTION_FILES
        .iter()
        .map(|name| open(name))
        .collect::<Result<Vec<_>, _>>()?;
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
    let texts = reproduction_files(&result).map_err(|e| Failure::new(Class::Io, e))?;
    let mut text = String::new();
    let mut written = Vec::new();
    for (place, (what, content)) in places.into_iter().zip(texts) {
        written.push((what, place.write(content.as_bytes())?));
    }
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
