//! Bytes on the target: `cargo run -p mpct --example sizes`.
//!
//! Tables are read only and may lie in flash; the workspace is RAM. Beside these a controller needs its own struct and the stack of
//! one step, which holds no array.

use mpct::runtime::{Controller as Target, Dims};
use mpct::{Controller, DesignOptions, TerminalIngredients, cases};
use std::error::Error;
use std::mem::size_of;

fn line(name: &str, number: &str, dims: Dims, products: &str, size: usize, itself: usize) {
    println!(
        "| {name} | {} × {} | {number} | {} | {} | {} | {itself} |",
        dims.variables(),
        dims.rows,
        dims.tables_len() * size,
        products,
        dims.workspace_len() * size + dims.index_len() * size_of::<u32>(),
    );
}

fn main() -> Result<(), Box<dyn Error>> {
    println!(
        "| problem | variables × rows | numbers | flash: tables | flash: products of rows | RAM: workspace | RAM: controller (here) |"
    );
    println!("|---|---|---|---|---|---|---|");
    let mut problems = vec![("academic".to_string(), cases::academic().problem)];
    for scaling in [0.9, 0.99] {
        let problem = cases::drone().problem.with_scaling(scaling)?;
        problems.push((format!("drone, scaling {scaling}"), problem));
    }
    for (name, problem) in problems {
        let ingredients = TerminalIngredients::design(&problem, &DesignOptions::default())?;
        let desk = Controller::new(ingredients)?;
        let (dims, numbers) = desk.runtime_tables().ok_or("no tables")?;
        // Of use in f64, where the desk found them worth their place.
        let products = match numbers.len() - dims.tables_len() {
            0 => "–".to_string(),
            length => (length * size_of::<f64>()).to_string(),
        };
        line(
            &name,
            "f32",
            dims,
            "–",
            size_of::<f32>(),
            size_of::<Target<'_, f32>>(),
        );
        line(
            &name,
            "f64",
            dims,
            &products,
            size_of::<f64>(),
            size_of::<Target<'_, f64>>(),
        );
    }
    Ok(())
}
