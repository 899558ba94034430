//! `pegbar completions`: a script that teaches a shell the commands and options.

use clap::CommandFactory;

use crate::args::{Cli, CompletionsArgs};
use crate::console::{Console, EXIT_OK};

pub(crate) fn completions(args: &CompletionsArgs, console: &mut Console) -> u8 {
    let mut script = Vec::new();
    clap_complete::generate(args.shell, &mut Cli::command(), "pegbar", &mut script);
    console.out(&String::from_utf8_lossy(&script));
    EXIT_OK
}
