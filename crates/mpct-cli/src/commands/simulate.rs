//! `mpct simulate`: design, closed loop, report and trajectories.

use crate::arguments::Simulate;
use crate::commands::{design_with_progress, duration, headline, read, vector};
use crate::failure::{Class, Failure};
use crate::output::{OutputFile, Waiting, note, print, print_json};
use crate::show::{show_page, shows_pages};
use mpct::{
    Controller, Formulation, Run, Simulation, SimulationError, StepStatus, TerminalIngredients,
};
use mpct_report::{Choice, Format, Region, Report};
use serde_json::json;
use std::fmt::Write;
use std::path::{Path, PathBuf};

pub fn run(arguments: &Simulate) -> Result<(), Failure> {
    let file = read(&arguments.file)?;
    let mut simulation = file.simulation.clone().ok_or_else(|| {
        Failure::new(
            Class::Input,
            "missing key `simulation`: what to simulate (initial_state, steps, setpoint)",
        )
        .in_file(&arguments.file)
    })?;
    if let Some(steps) = arguments.steps {
        simulation.steps = steps;
    }
    if arguments.open && arguments.report.is_none() && (arguments.no_files || arguments.json) {
        return Err(Failure::new(
            Class::Input,
            "--open needs a report, and none is written with --no-files or --json",
        )
        .help("name one with --report"));
    }
    let report = output(arguments, arguments.report.as_deref(), "html")?;
    let csv = output(arguments, arguments.csv.as_deref(), "csv")?;
    let drawing = match &arguments.picture {
        Some(path) => {
            let choice = Choice::of(&file.problem, &arguments.signals)
                .map_err(|message| Failure::new(Class::Input, message))?;
            let format = Format::of(path).map_err(|m| Failure::new(Class::Input, m))?;
            Some((OutputFile::open(path)?, choice, format))
        }
        None => None,
    };
    let outputs = [
        report.as_ref(),
        csv.as_ref(),
        drawing.as_ref().map(|d| &d.0),
    ];
    OutputFile::all_apart(&arguments.file, outputs.into_iter().flatten())?;
    let mut problem = file.problem;
    if let Some(formulation) = arguments.formulation {
        problem = problem.with_formulation(formulation.into());
    }
    let ingredients = design_with_progress(&problem, &arguments.limits)
        .map_err(|f| f.in_file(&arguments.file))?;
    let mut controller =
        Controller::new(ingredients).map_err(|e| Failure::from(e).in_file(&arguments.file))?;
    let run = {
        let waiting = Waiting::new("closed loop", Some(simulation.steps as u64));
        mpct::simulate(
            &mut controller,
            &simulation,
            Some(&|done| waiting.at(done as u64, String::new())),
        )
    };
    let run = match run {
        Ok(run) => run,
        Err(error) => {
            // What was done before the failing step is worth having.
            if let (SimulationError::Step { run, .. }, Some(csv)) = (&error, csv)
                && !run.steps.is_empty()
            {
                let path = csv.write(&trajectories(run)?)?;
                note(&format!(
                    "the {} steps before the error are in {}",
                    run.steps.len(),
                    path.display()
                ));
            }
            return Err(Failure::from(error).in_file(&arguments.file));
        }
    };
    let mut written = Vec::new();
    let mut regions = Vec::new();
    let examined = controller.formulation() == Formulation::NoTerminalConstraint;
    if report.is_some() || drawing.is_some() || examined {
        let data = Report::new(
            controller.ingredients(),
            &run,
            simulation.disturbance.is_some(),
        )
        .with_proofs(&controller, &run);
        regions = data.regions().to_vec();
        if let Some(report) = report {
            written.push(("report", report.write(data.page().as_bytes())?));
        }
        if let Some((file, choice, format)) = drawing {
            let bytes = format
                .encode(&data.picture(&choice))
                .map_err(|m| Failure::new(Class::Io, format!("cannot draw the picture: {m}")))?;
            written.push(("picture", file.write(&bytes)?));
        }
    }
    if let Some(csv) = csv {
        written.push(("trajectories", csv.write(&trajectories(&run)?)?));
    }
    if arguments.open
        && let Some((_, path)) = written.iter().find(|w| w.0 == "report")
    {
        match shows_pages() {
            Ok(()) => show_page(path),
            Err(why) => note(&format!("{why}; the report is {}", path.display())),
        }
    }
    if arguments.json {
        return print_json(&json!({
            "terminal_horizon": controller.ingredients().terminal_horizon(),
            "steps": run.steps,
            "summary": run.summary,
        }));
    }
    print(&summary(
        controller.ingredients(),
        &simulation,
        &run,
        &regions,
        &written,
    ))
}

/// The file for a kind of output, unless none is wanted. Its place is tried before the work begins.
fn output(
    arguments: &Simulate,
    named: Option<&Path>,
    extension: &str,
) -> Result<Option<OutputFile>, Failure> {
    let path = match named {
        Some(path) => path.to_path_buf(),
        None if arguments.no_files || arguments.json => return Ok(None),
        None => {
            let stem = arguments.file.file_stem().unwrap_or("mpct".as_ref());
            PathBuf::from(stem).with_extension(extension)
        }
    };
    OutputFile::open(&path).map(Some)
}

/// The run as CSV, one line a step.
fn trajectories(run: &Run) -> Result<Vec<u8>, Failure> {
    let failed = |e: csv::Error| Failure::new(Class::Io, format!("cannot write CSV: {e}"));
    let mut writer = csv::Writer::from_writer(Vec::new());
    if let Some(first) = run.steps.first() {
        let names = |what: &str, n: usize| {
            (0..n)
                .map(move |i| format!("{what}[{i}]"))
                .collect::<Vec<_>>()
        };
        let mut header = vec!["k".to_string()];
        header.extend(names("x", first.x.len()));
        header.extend(names("u", first.u.len()));
        header.extend(names("artificial_state", first.artificial_state.len()));
        header.extend(names("artificial_input", first.artificial_input.len()));
        header.extend(names("setpoint", first.setpoint.len()));
        header.extend(
            [
                "cost",
                "offset_cost",
                "admissible",
                "status",
                "iterations",
                "solve_seconds",
            ]
            .map(String::from),
        );
        writer.write_record(&header).map_err(failed)?;
    }
    for step in &run.steps {
        let mut record = vec![step.k.to_string()];
        for part in [
            &step.x,
            &step.u,
            &step.artificial_state,
            &step.artificial_input,
            &step.setpoint,
        ] {
            record.extend(part.iter().map(|v| v.to_string()));
        }
        record.extend([
            step.cost.to_string(),
            step.offset_cost.to_string(),
            step.admissible.to_string(),
            step.status.to_string(),
            step.iterations.to_string(),
            step.solve_seconds.to_string(),
        ]);
        writer.write_record(&record).map_err(failed)?;
    }
    writer
        .into_inner()
        .map_err(|e| Failure::new(Class::Io, format!("cannot write CSV: {e}")))
}

fn summary(
    ingredients: &TerminalIngredients,
    simulation: &Simulation,
    run: &Run,
    regions: &[Region],
    written: &[(&str, PathBuf)],
) -> String {
    let mut text = headline(ingredients.problem()) + "\n";
    let figures = &run.summary;
    let mut line = |what: &str, value: String| {
        let _ = writeln!(text, "  {what:<22} {value}");
    };
    line(
        "terminal horizon",
        format!(
            "{} ({} condition, found in {})",
            ingredients.terminal_horizon(),
            ingredients.condition(),
            duration(ingredients.elapsed().as_secs_f64())
        ),
    );
    line("steps", run.steps.len().to_string());
    line(
        "cumulative cost",
        format!("{:.6e}", figures.cumulative_cost),
    );
    line(
        "worst violation",
        format!("{:.1e}", figures.worst_violation),
    );
    let changes: Vec<&mpct::RunStep> = run
        .steps
        .iter()
        .filter(|s| s.k == 0 || simulation.set_points.iter().any(|p| p.from_step == s.k))
        .collect();
    let admissible = changes.iter().filter(|s| s.admissible).count();
    line(
        "set-points",
        format!("{} ({admissible} admissible)", changes.len()),
    );
    let candidates = run
        .steps
        .iter()
        .filter(|s| s.status != StepStatus::Optimal)
        .count();
    if candidates > 0 {
        line("shifted candidates", candidates.to_string());
    }
    line(
        "time a step",
        format!(
            "{} mean, {} largest",
            duration(figures.mean_solve_seconds),
            duration(figures.max_solve_seconds)
        ),
    );
    for (k, region) in regions {
        let words = match region {
            Ok(r) => format!(
                "{} at step {k}: {:.6e} {} {:.6e}",
                if r.is_inside() { "inside" } else { "outside" },
                r.cost,
                if r.is_inside() { "<=" } else { ">" },
                r.level
            ),
            Err(why) => format!("none at step {k}: {why}"),
        };
        line("stability region", words);
    }
    line("final state", vector(&figures.final_state));
    line("final artificial", vector(&figures.final_artificial_state));
    for (what, path) in written {
        line(what, path.display().to_string());
    }
    text
}
