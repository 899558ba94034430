//! A plugin's library in this process.
#![allow(unsafe_code, reason = "loading a library and calling it; each block says what it relies on")]

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, MutexGuard, OnceLock, PoisonError};

use libloading::Library;
use pegbar_abi::{ENTRY, PB_ABI_MAJOR, PB_ABI_MINOR, PbPlugin, PbPluginEntry, PbTask};

use super::PluginError;
use super::call::{Request, Response, Settings, Transport};
use super::manifest::{Description, Manifest, Threads};
use super::shown::{show_settings, size};
use super::suite::{Call, host, read_text};
use crate::node::NodeError;

/// The functions of a loaded library, which stays loaded.
#[derive(Clone, Copy)]
struct Functions(&'static PbPlugin);

// SAFETY: the ABI says that the struct lives as long as the process and that its functions may be called from any thread; what may not run at once is seen
// to by `Loaded`.
unsafe impl Send for Functions {}
// SAFETY: as above.
unsafe impl Sync for Functions {}

struct Loaded {
    functions: Functions,
    threads: Threads,
    /// For a plugin of which one call at a time may run.
    turn: Arc<Mutex<()>>,
}

/// Calls within this process. Loads the library when the first call comes.
pub(super) struct InProcess {
    manifest: Arc<Manifest>,
    folder: PathBuf,
    /// As errors name it.
    name: String,
    /// False where no code is to run.
    may_load: bool,
    loaded: OnceLock<Result<Loaded, PluginError>>,
}

/// The digest of a library, in hexadecimal, as manifests have it.
///
/// # Errors
/// Where the file cannot be read.
pub fn digest(library: &Path) -> Result<String, PluginError> {
    let mut hasher = blake3::Hasher::new();
    let read = std::fs::File::open(library).and_then(|mut file| std::io::copy(&mut file, &mut hasher));
    read.map_err(|e| PluginError::new(format!("library {}: {e}", library.display())))?;
    Ok(hasher.finalize().to_hex().to_string())
}

/// Loads a library and reads what it says of itself. Runs its code.
///
/// # Errors
/// Where it is no plugin that this host can use.
pub fn describe(library: &Path) -> Result<Description, PluginError> {
    open(library, &digest(library)?).map(|(_, description)| description)
}

/// Says where another library was loaded from this path before: the system would give that one again, whatever lies there now.
fn first_here(path: &Path, digest: &str) -> Result<(), String> {
    static LOADED: Mutex<BTreeMap<PathBuf, String>> = Mutex::new(BTreeMap::new());
    let mut loaded = LOADED.lock().unwrap_or_else(PoisonError::into_inner);
    let before = loaded.entry(path.to_owned()).or_insert_with(|| digest.to_owned());
    match before == digest {
        true => Ok(()),
        false => {
            Err(format!("expected the library that this process has loaded from there, of digest {}, found it changed", short(before)))
        }
    }
}

fn open(path: &Path, digest: &str) -> Result<(Functions, Description), PluginError> {
    let refused = |why: String| PluginError::new(format!("library {}: {why}", path.display()));
    // The loader looks for a bare name elsewhere.
    let absolute = std::path::absolute(path).map_err(|e| refused(e.to_string()))?;
    first_here(&absolute, digest).map_err(|why| refused(why).help("start Pegbar anew"))?;
    // SAFETY: the user or the show named this plugin; whatever its initialisers do is what they asked for.
    let library = unsafe { Library::new(&absolute) }.map_err(|e| refused(format!("expected a shared library, found {}", cause(&e))))?;
    // SAFETY: the symbol is what the ABI says it is.
    let entry = unsafe { library.get::<PbPluginEntry>(ENTRY.as_bytes()) };
    let entry = *entry.map_err(|_| refused(format!("expected a plugin that exports `{ENTRY}`, found none")))?;
    // SAFETY: the entry point is called as the ABI says, with a host that lives as long as the process.
    let plugin = unsafe { entry(host()) };
    // Values, threads and statics of the library may outlive any use of it that is known here.
    std::mem::forget(library);
    if plugin.is_null() {
        let host = format!("pegbar {} with ABI {PB_ABI_MAJOR}.{PB_ABI_MINOR}", env!("CARGO_PKG_VERSION"));
        return Err(refused(format!("expected a plugin for this host ({host}), found one that will not work with it")));
    }
    // SAFETY: every version of the struct begins with its size and the major version of the ABI.
    let (struct_size, major) = unsafe { (*plugin.cast::<u32>(), *plugin.cast::<u32>().add(1)) };
    if major != PB_ABI_MAJOR {
        let help = "have the plugin built for this Pegbar, or use the Pegbar that it was built for";
        return Err(refused(format!("expected a plugin for ABI {PB_ABI_MAJOR}, found one for ABI {major}")).help(help));
    }
    if struct_size < size::<PbPlugin>() {
        return Err(refused(format!("expected a PbPlugin of at least {} bytes, found {struct_size}", size::<PbPlugin>())));
    }
    // SAFETY: it is as large as it must be, and lives as long as the process.
    let functions = Functions(unsafe { &*plugin });
    // SAFETY: the text lives as long as the plugin.
    let schema = unsafe { read_text(functions.0.schema) };
    let description =
        Description::parse(&schema).map_err(|why| refused(format!("expected a schema, found one that cannot be read: {why}")))?;
    if description.abi != (functions.0.abi_major, functions.0.abi_minor) {
        let (major, minor) = description.abi;
        let found = format!("{}.{} in its PbPlugin", functions.0.abi_major, functions.0.abi_minor);
        return Err(refused(format!("expected ABI {major}.{minor} as its schema says, found {found}")));
    }
    Ok((functions, description))
}

/// What the system says of a library that it does not load.
fn cause(error: &libloading::Error) -> String {
    std::error::Error::source(error).map_or_else(|| error.to_string(), ToString::to_string)
}

impl InProcess {
    pub(super) fn new(manifest: Arc<Manifest>, folder: PathBuf, may_load: bool) -> Self {
        let name = format!("plugin `{}` {}", manifest.plugin.name, manifest.plugin.version);
        Self { manifest, folder, name, may_load, loaded: OnceLock::new() }
    }

    fn loaded(&self) -> Result<&Loaded, NodeError> {
        self.loaded.get_or_init(|| self.load()).as_ref().map_err(|e| e.clone().into())
    }

    fn load(&self) -> Result<Loaded, PluginError> {
        let plugin = &self.manifest.plugin;
        if !self.may_load {
            let why = "expected a node whose manifest says which frames it reads, found one whose code has to be asked";
            let help = "this command runs no code of plugins; an input says its frames by a `window`, and `pegbar run` asks";
            return Err(PluginError::plugin(plugin, why).help(help));
        }
        let (path, expected) = self.manifest.library(&self.folder)?;
        let anew = format!("`pegbar plugin manifest {}` writes the manifest anew", path.display());
        let found = digest(&path).map_err(|e| PluginError::plugin(plugin, e))?;
        if found != expected {
            let (expected, found) = (short(expected), short(&found));
            let why = format!("expected the library {} of digest {expected}, as its manifest says, found {found}", path.display());
            return Err(PluginError::plugin(plugin, why).help(anew));
        }
        let (functions, description) =
            open(&path, &found).map_err(|e| PluginError { message: PluginError::plugin(plugin, e.message).message, ..e })?;
        if let Some((what, ours, theirs)) = plugin.difference(&description) {
            let why = format!("{what}: expected {ours}, as its manifest says, found {theirs} in the library {}", path.display());
            return Err(PluginError::plugin(plugin, why).help(anew));
        }
        Ok(Loaded { functions, threads: plugin.threads, turn: Arc::default() })
    }

    fn call(
        &self,
        request: &Request,
        function: impl FnOnce(&PbPlugin) -> unsafe extern "C" fn(*mut u8, *const PbTask) -> u32,
    ) -> Result<Response, NodeError> {
        let loaded = self.loaded()?;
        let _turn = (loaded.threads == Threads::One).then(|| loaded.turn.lock().unwrap_or_else(PoisonError::into_inner));
        let instance = Lent::new(loaded, request, &self.name)?;
        let function = function(loaded.functions.0);
        let call = Call::new(request, &self.name);
        // SAFETY: the instance is one of this plugin's and lives as long as it is lent; the task lives as long as the call; what may not run at once does
        // not, as `Lent` sees to.
        let status = call.show(|task| unsafe { function(instance.at, task) });
        call.end(status)
    }
}

/// The beginning of a digest, for messages.
pub(super) fn short(digest: &str) -> &str {
    digest.get(..16).unwrap_or(digest)
}

impl Transport for InProcess {
    fn compute(&self, request: &Request) -> Result<Response, NodeError> {
        self.call(request, |plugin| plugin.compute)
    }

    fn needs(&self, request: &Request) -> Result<Response, NodeError> {
        self.call(request, |plugin| plugin.needs)
    }
}

/// An instance of a node type; ended when it is dropped.
struct Instance {
    plugin: Functions,
    at: *mut u8,
    turn: Option<Arc<Mutex<()>>>,
}

// SAFETY: the ABI has instances used from any thread; what may not run at once is seen to by `Lent`.
unsafe impl Send for Instance {}
// SAFETY: as above.
unsafe impl Sync for Instance {}

impl Instance {
    fn new(loaded: &Loaded, request: &Request, name: &str) -> Result<Self, NodeError> {
        let mut at = std::ptr::null_mut();
        let bare = Request { ports: Vec::new(), state: None, ..*request };
        let call = Call::new(&bare, name);
        let create = loaded.functions.0.create;
        let status = show_settings(request.settings, |settings| {
            // SAFETY: the node is one of the schema's, which is the manifest's; task and settings live as long as the call.
            call.show(|task| unsafe { create(request.node, task, settings, &raw mut at) })
        });
        let turn = (loaded.threads == Threads::One).then(|| loaded.turn.clone());
        call.end(status).map(|_| Self { plugin: loaded.functions, at, turn })
    }
}

impl Drop for Instance {
    fn drop(&mut self) {
        let _turn = self.turn.as_ref().map(|turn| turn.lock().unwrap_or_else(PoisonError::into_inner));
        // SAFETY: `create` made it, nobody uses it any longer, and it is ended once.
        unsafe { (self.plugin.0.destroy)(self.at) };
    }
}

/// What is kept for settings: one instance for all threads, or one for each that runs at once.
enum Instances {
    One(Instance),
    Several(Mutex<Several>),
}

#[derive(Default)]
struct Several {
    all: Vec<Instance>,
    /// Positions of those that no call has.
    idle: Vec<usize>,
}

/// An instance for one call.
struct Lent<'a> {
    at: *mut u8,
    /// Where it goes back to, and its position there.
    home: Option<(&'a Mutex<Several>, usize)>,
}

fn locked(several: &Mutex<Several>) -> MutexGuard<'_, Several> {
    several.lock().unwrap_or_else(PoisonError::into_inner)
}

impl<'a> Lent<'a> {
    fn new(loaded: &Loaded, request: &Request<'a>, name: &str) -> Result<Self, NodeError> {
        let settings: &'a Arc<Settings> = request.settings;
        let kept = match settings.kept.get().and_then(|kept| kept.downcast_ref::<Instances>()) {
            Some(kept) => kept,
            None => {
                let made = match loaded.threads {
                    Threads::Instance => Instances::Several(Mutex::default()),
                    Threads::Any | Threads::One => Instances::One(Instance::new(loaded, request, name)?),
                };
                // Of two that were made at once the later is ended again, at once but for a plugin that takes turns, where no other can be.
                let kept = settings.kept.get_or_init(|| Box::new(made));
                kept.downcast_ref::<Instances>().ok_or_else(|| NodeError::internal("what is kept for settings is another transport's"))?
            }
        };
        let home = match kept {
            Instances::One(instance) => return Ok(Self { at: instance.at, home: None }),
            Instances::Several(home) => home,
        };
        let mut several = locked(home);
        if let Some(position) = several.idle.pop() {
            return Ok(Self { at: several.all[position].at, home: Some((home, position)) });
        }
        drop(several);
        let made = Instance::new(loaded, request, name)?;
        let at = made.at;
        let mut several = locked(home);
        several.all.push(made);
        Ok(Self { at, home: Some((home, several.all.len() - 1)) })
    }
}

impl Drop for Lent<'_> {
    fn drop(&mut self) {
        if let Some((home, position)) = self.home {
            locked(home).idle.push(position);
        }
    }
}
