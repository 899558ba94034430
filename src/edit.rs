//! `pegbar edit`: changes of a graph file from scripts.

use std::io::Write;

use pegbar_engine::atomic;
use pegbar_engine::edit::{Edit, apply};

use crate::args::EditArgs;
use crate::console::{Console, EXIT_OK, EXIT_WRONG};

pub(crate) fn edit(args: &EditArgs, console: &mut Console) -> u8 {
    match changed(args) {
        Ok(text) if args.print => {
            console.out(&text);
            EXIT_OK
        }
        Ok(text) => match atomic::write(&args.graph, |out| out.write_all(text.as_bytes())) {
            Ok(()) => EXIT_OK,
            Err(error) => wrong(&error.to_string(), console),
        },
        Err(message) => wrong(&format!("{}: {message}", args.graph.display()), console),
    }
}

fn wrong(message: &str, console: &mut Console) -> u8 {
    console.say(&format!("error: {message}\n"));
    EXIT_WRONG
}

/// The text of the graph after all edits.
fn changed(args: &EditArgs) -> Result<String, String> {
    let edits = edits(args)?;
    if edits.is_empty() {
        return Err("expected --set, --unset, --rename, --rename-param, --add or --remove, found none".to_owned());
    }
    let text = std::fs::read_to_string(&args.graph).map_err(|e| e.to_string())?;
    edits.iter().try_fold(text, |text, edit| apply(&text, edit).map_err(|e| e.to_string()))
}

fn edits(args: &EditArgs) -> Result<Vec<Edit>, String> {
    let path = |name: &str| match name.split_once('.') {
        Some((node, input)) => Ok(["nodes", node, input].map(str::to_owned)),
        None => Err(format!("expected NODE.INPUT, found `{name}`")),
    };
    let mut edits = Vec::new();
    for (name, value) in &args.set {
        edits.push(Edit::Set { path: path(name)?, value: value.clone() });
    }
    for name in &args.unset {
        edits.push(Edit::Unset { path: path(name)? });
    }
    let pairs = |list: &[(String, String)]| list.to_vec();
    edits.extend(pairs(&args.rename).into_iter().map(|(from, to)| Edit::RenameNode { from, to }));
    edits.extend(pairs(&args.rename_param).into_iter().map(|(from, to)| Edit::RenameParam { from, to }));
    edits.extend(pairs(&args.add).into_iter().map(|(name, record)| Edit::AddNode { name, record }));
    edits.extend(args.remove.iter().map(|name| Edit::RemoveNode { name: name.clone() }));
    Ok(edits)
}
