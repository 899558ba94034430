//! The command line.

use std::io::IsTerminal;
use std::process::ExitCode;
use std::time::Duration;

use pegbar::{Console, EXIT_CANCELLED, run_cli};
use pegbar_engine::node::Cancel;

/// How long a run that is asked to stop may take to do so by itself.
const PATIENCE: Duration = Duration::from_millis(25);

#[global_allocator]
static POOL: pegbar::Pool = pegbar::Pool;

fn main() -> ExitCode {
    pegbar_engine::plugin::serve_if_asked();
    let cancel = Cancel::default();
    let handle = cancel.clone();
    // Without the handler Ctrl-C still ends the process, so a failure to set it is no reason not to run.
    let _ = ctrlc::set_handler(move || {
        handle.cancel();
        // A node may be in the middle of something long. Whatever is cut off here is as if the process were killed: no file is there by half.
        std::thread::sleep(PATIENCE);
        eprintln!("cancelled: files that are there are whole");
        pegbar::leave(EXIT_CANCELLED);
    });
    let is_terminal = std::io::stderr().is_terminal();
    let no_color = std::env::var_os("NO_COLOR").is_some_and(|v| !v.is_empty());
    let (mut stdout, mut stderr) = (std::io::stdout(), std::io::stderr());
    let mut console = Console { stdout: &mut stdout, stderr: &mut stderr, is_terminal, colour: is_terminal && !no_color, cancel };
    ExitCode::from(run_cli(std::env::args_os(), &pegbar_nodes::registry(), &mut console))
}
