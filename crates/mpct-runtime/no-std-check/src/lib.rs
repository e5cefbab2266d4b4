//! Proof that the solver links without std and without a heap: memory on the stack, tables from the caller.
//!
//! The tables must be unknown to the compiler: with constant ones (all zero, say) it finds out that they are refused and
//! leaves the solver away, and the proof proves nothing. The linked code must have tens of kilobytes.
#![no_std]

use mpct_runtime::{Budget, Controller, Dims, Tables, Workspace};

const DIMS: Dims = Dims {
    states: 2,
    inputs: 2,
    horizon: 10,
    set_point: 4,
    rows: 136,
    input_rows: 4,
};

#[panic_handler]
fn panic(_: &core::panic::PanicInfo<'_>) -> ! {
    loop {}
}

/// One step from `(x, 0)` with exported tables; 0 when `u` was written.
#[unsafe(no_mangle)]
pub extern "C" fn mpct_check_step(
    tables: Option<&[f32; DIMS.tables_len()]>,
    x0: f32,
    x1: f32,
    u: Option<&mut [f32; 2]>,
) -> i32 {
    let Some(tables) = tables else { return 5 };
    let (mut numbers, mut indices) = ([0.0; DIMS.workspace_len()], [0; DIMS.index_len()]);
    let Ok(tables) = Tables::from_slice(DIMS, tables) else {
        return 1;
    };
    let Ok(workspace) = Workspace::new(DIMS, &mut numbers, &mut indices) else {
        return 2;
    };
    let Ok(mut controller) = Controller::new(tables, workspace) else {
        return 3;
    };
    match (
        controller.step(&[x0, x1], &[0.0; 4], Budget::iterations(50)),
        u,
    ) {
        (Ok(step), Some(u)) => {
            u.copy_from_slice(step.input);
            0
        }
        _ => 4,
    }
}
