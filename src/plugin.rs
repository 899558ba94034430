//! `pegbar plugin`: manifests, locks and checks; and the plugins that a command line names.

mod check;

use std::path::{Path, PathBuf};

use pegbar_engine::check::{LoadOptions, code, load};
use pegbar_engine::plugin::{self, ENDING, LibraryFile, Lock, Manifest, PluginError, describe, platform};
use pegbar_engine::registry::Registry;

use crate::args::{GraphArgs, PluginCommand};
use crate::check::say_total;
use crate::console::{Console, EXIT_FAILED, EXIT_OK, EXIT_WRONG, count};

/// Variable that names plugins, as `--plugins` does; several with the separator of PATH between.
const VARIABLE: &str = "PEGBAR_PLUGINS";

/// The registry with the plugins that the command line and the environment name; an exit code where one of them cannot be had. No code
/// of theirs runs but in commands that run nodes.
pub(crate) fn registry(own: &Registry, named: &[PathBuf], runs: bool, console: &mut Console) -> Result<Registry, u8> {
    let mut registry = if runs { own.clone() } else { own.clone().without_code() };
    let variable = std::env::var_os(VARIABLE).unwrap_or_default();
    let more = std::env::split_paths(&variable).filter(|p| !p.as_os_str().is_empty());
    let paths: Vec<PathBuf> = named.iter().cloned().chain(more).collect();
    let (found, mut wrong) = plugin::found_in(&paths);
    wrong.extend(found.iter().filter_map(|one| one.register(&mut registry).err()));
    wrong.iter().for_each(|error| say(code::PLUGIN, error, console));
    if wrong.is_empty() { Ok(registry) } else { Err(EXIT_WRONG) }
}

fn say(code: &str, error: &PluginError, console: &mut Console) {
    console.say(&format!("error[{code}]: {error}\n"));
    if let Some(help) = &error.help {
        console.say(&format!("  help: {help}\n"));
    }
}

pub(crate) fn plugin(command: &PluginCommand, registry: &Registry, console: &mut Console) -> u8 {
    let done = match command {
        PluginCommand::Manifest { library } => manifest(library).map(|path| format!("{}: written\n", path.display())),
        PluginCommand::New { path, lang, sdk } => return crate::new::plugin::plugin(path, *lang, sdk.as_deref(), console),
        PluginCommand::Check(args) => return check::check(args, console),
        PluginCommand::Probe(args) => return check::probe(args, registry, console),
        PluginCommand::Lock(graph) => match lock(graph, registry, console) {
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

/// Pins the plugins of a graph; `None` where the graph is wrong, which is said.
fn lock(args: &GraphArgs, registry: &Registry, console: &mut Console) -> Option<Result<String, PluginError>> {
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
        lock.write(folder)
    });
    let listed: String = used.iter().map(|id| format!("  {} {}  {}\n", id.name, id.version, id.digest)).collect();
    Some(written.map(|()| format!("{}: {} pinned\n{listed}", folder.join(plugin::LOCK).display(), count(used.len(), "plugin"))))
}
