//! `mpct verify`: is a design what it claims to be?

use crate::arguments::Verify;
use crate::failure::{Class, Failure};
use crate::output::{print, print_json};
use mpct::certificate::{VerifyError, VerifyOptions, verify};
use serde_json::json;

pub fn run(arguments: &Verify) -> Result<(), Failure> {
    let text = std::fs::read_to_string(&arguments.file)
        .map_err(|e| Failure::io("read", &arguments.file, &e))?;
    let options = VerifyOptions {
        ignore_digest: arguments.ignore_digest,
    };
    let verified = verify(&text, options).map_err(|e| {
        let failure = Failure::new(Class::Input, e.to_string()).in_file(&arguments.file);
        match e {
            VerifyError::Digest => failure.help("--ignore-digest checks the claim all the same"),
            _ => failure,
        }
    })?;
    if arguments.json {
        return print_json(&json!({
            "name": verified.problem,
            "digest": verified.digest,
            "digest_fits": verified.digest_fits,
            "scaling": verified.scaling,
            "terminal_horizon": verified.terminal_horizon,
            "smallest_margin": verified.smallest_margin,
            "tightest_row": verified.tightest_row,
            "rows_rigorous": verified.rows_rigorous,
            "rows_to_tolerance": verified.rows_to_tolerance,
            "ellipsoids": verified.ellipsoids,
            "lyapunov_residual": verified.lyapunov_residual,
            "steady_state_residual": verified.steady_state_residual,
            "witness": verified.witness,
            "statement": verified.to_string(),
        }));
    }
    print(&format!("{verified}\n"))
}
