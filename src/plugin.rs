//! `pegbar plugin`: manifests, locks and checks; and the plugins that a command line names.

mod check;

use std::path::{Path, PathBuf};

use pegbar_engine::check::{LoadOptions, code, load};
use pegbar_engine::plugin::{self, ENDING, Isolation, LibraryFile, Lock, Manifest, PluginError, Workers, describe, platform};
use pegbar_engine::registry::Registry;

use crate::args::{Cli, Command, GraphArgs, IsolationArgs, PluginCommand};
use crate::check::say_total;
use crate::console::{Console, EXIT_FAILED, EXIT_OK, EXIT_WRONG, count};

/// Variable that names plugins, as `--plugins` does; several with the separator of PATH between.
const VARIABLE: &str = "PEGBAR_PLUGINS";

/// The registry with the plugins that the command line and the environment name; an exit code where one of them cannot be had. No code
/// of theirs runs but in commands that run nodes.
pub(crate) fn registry(own: &Registry, cli: &Cli, console: &mut Console) -> Result<Registry, u8> {
    let mut registry = match runs(&cli.command) {
        Some((graph, out)) => own.clone().with_isolation(isolation(own.isolation(), &cli.isolation, graph, out)),
        None => own.clone().without_code(),
    };
    let named = &cli.plugins;
    let variable = std::env::var_os(VARIABLE).unwrap_or_default();
    let more = std::env::split_paths(&variable).filter(|p| !p.as_os_str().is_empty());
    let paths: Vec<PathBuf> = named.iter().cloned().chain(more).collect();
    let (found, mut wrong) = plugin::found_in(&paths);
    wrong.extend(found.iter().filter_map(|one| one.register(&mut registry).err()));
    wrong.iter().for_each(|error| say(code::PLUGIN, error, console));
    if wrong.is_empty() { Ok(registry) } else { Err(EXIT_WRONG) }
}

/// For a command that runs nodes, its graph and the folder that they write to.
fn runs(command: &Command) -> Option<(Option<&Path>, Option<&Path>)> {
    match command {
        Command::Run(args) => Some((Some(&args.graph.graph), Some(&args.graph.out))),
        Command::Wedge(args) => Some((Some(&args.graph.graph), Some(&args.graph.out))),
        Command::Replay(args) => Some((None, args.out.as_deref())),
        Command::Test(_) => Some((None, None)),
        _ => None,
    }
}

/// Where plugins run.
fn isolation(own: &Isolation, args: &IsolationArgs, graph: Option<&Path>, out: Option<&Path>) -> Isolation {
    let workers = match own {
        Isolation::Off => None,
        Isolation::Auto => plugin::own_program().map(Workers::new),
        Isolation::Workers(workers) => Some((**workers).clone()),
    };
    let Some(mut workers) = workers else { return Isolation::Off };
    if let Some(timeout) = args.plugin_timeout {
        workers.timeout = (!timeout.is_zero()).then_some(timeout);
    }
    workers.memory = args.plugin_memory.unwrap_or(workers.memory);
    workers.writable.extend(out.and_then(|out| std::path::absolute(out).ok()));
    workers.trusted.extend(args.trust.iter().cloned());
    // A lock that cannot be read is told of where the graph is checked.
    let lock = graph.and_then(|graph| Lock::read(graph.parent().unwrap_or(Path::new(""))).ok().flatten());
    workers.trusted.extend(lock.into_iter().flat_map(|lock| lock.trusted));
    Isolation::Workers(Box::new(workers))
}

fn say(code: &str, error: &PluginError, console: &mut Console) {
    console.say(&format!("error[{code}]: {error}\n"));
    if let Some(help) = &error.help {
        console.say(&format!("  help: {help}\n"));
    }
}

pub(crate) fn plugin(command: &PluginCommand, trust: &[String], registry: &Registry, console: &mut Console) -> u8 {
    let done = match command {
        PluginCommand::Manifest { library } => manifest(library).map(|path| format!("{}: written\n", path.display())),
        PluginCommand::New { path, lang, sdk } => return crate::new::plugin::plugin(path, *lang, sdk.as_deref(), console),
        PluginCommand::Check(args) => return check::check(args, console),
        PluginCommand::Probe(args) => return check::probe(args, registry, console),
        PluginCommand::Lock(graph) => match lock(graph, trust, registry, console) {
            Some(done) => done,
            None => return EXIT_WRONG,
        },
    };
    match done {
        Ok(text) => {
            console.out(&text);
            EXIT_OK
        }
        Err(error) => {
            say(code::PLUGIN, &error, console);
            EXIT_FAILED
        }
    }
}

/// Writes the manifest of a library; what it says of other platforms stays, if it is of the same plugin.
fn manifest(library: &Path) -> Result<PathBuf, PluginError> {
    let plugin = describe(library)?;
    let path = library.with_file_name(format!("{}{ENDING}", plugin.name));
    let known = Manifest::read(&path).ok().filter(|known| known.plugin == plugin);
    let mut libraries = known.map(|known| known.libraries).unwrap_or_default();
    let file = library.file_name().unwrap_or_default().to_string_lossy().into_owned();
    libraries.insert(platform(), LibraryFile { file, digest: plugin::digest(library)? });
    Manifest { libraries, plugin }.write(&path).map(|()| path)
}

/// Pins the plugins of a graph, and notes which are trusted; `None` where the graph is wrong, which is said.
fn lock(args: &GraphArgs, trust: &[String], registry: &Registry, console: &mut Console) -> Option<Result<String, PluginError>> {
    let loaded = load(&args.graph, registry, &LoadOptions { unlocked: true, ..args.load_options() });
    console.diagnostics(&loaded.sources, &loaded.diagnostics);
    let Some(graph) = &loaded.graph else {
        say_total(&args.graph.display().to_string(), &loaded, console);
        return None;
    };
    let folder = args.graph.parent().unwrap_or(Path::new(""));
    let mut used: Vec<_> = graph.nodes.iter().filter_map(|node| node.ty.operator.plugin()).collect();
    used.sort_by_key(|id| (&id.name, &id.version));
    used.dedup();
    let written = Lock::read(folder).and_then(|lock| {
        let mut lock = lock.unwrap_or_default();
        used.iter().for_each(|id| lock.pin(id));
        lock.trusted.extend(trust.iter().cloned());
        lock.write(folder)
    });
    let listed: String = used.iter().map(|id| format!("  {} {}  {}\n", id.name, id.version, id.digest)).collect();
    Some(written.map(|()| format!("{}: {} pinned\n{listed}", folder.join(plugin::LOCK).display(), count(used.len(), "plugin"))))
}
