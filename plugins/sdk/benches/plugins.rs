//! What a call of a plugin costs, in this process, in a worker, and in one that is reached over sockets: nodes that do next to nothing, beside the same
//! nodes built in, and a filter of a picture in full HD.
//!
//! The ways take turns, and the least of each counts, which other programs on the machine disturb least. The allocator is the program's, so that pictures
//! lie where workers see them.

use std::error::Error;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::Arc;
use std::time::{Duration, Instant};

use pegbar_engine::Value;
use pegbar_engine::array::NdArray;
use pegbar_engine::clock::Clock;
use pegbar_engine::node::{Arg, Cancel, Context, InputSchema, InputType};
use pegbar_engine::plugin::{
    ENDING, Isolation, LibraryFile, Manifest, Workers, describe, digest, find, own_program, platform, serve_if_asked,
};
use pegbar_engine::registry::{NodeType, Registry};
use pegbar_engine::setting::Place;
use pegbar_engine::value::{ValueRef, Vector};
use sums::{SumsBlend, SumsJoin, SumsNext};

#[allow(dead_code, unreachable_pub, unused_imports, reason = "the program's own file, of which this uses the allocator alone")]
#[path = "../../../src/pool.rs"]
mod pool;

#[global_allocator]
static POOL: pool::Pool = pool::Pool;

/// A picture.
#[derive(Clone, Debug, Value)]
struct Clip {
    /// Samples.
    #[value(shape = "[c, h, w]")]
    planes: NdArray<f32, 3>,
}

/// A plugin's manifest, in a folder with its library.
fn describe_in(folder: &Path, name: &str) -> Result<PathBuf, Box<dyn Error>> {
    let library = folder.join(name);
    let plugin = describe(&library)?;
    let libraries = [(platform(), LibraryFile { file: name.to_owned(), digest: digest(&library)? })].into();
    let path = folder.join(format!("{}{ENDING}", plugin.name));
    Manifest { libraries, plugin }.write(&path)?;
    Ok(path)
}

fn build_in_c(folder: &Path) -> Result<PathBuf, Box<dyn Error>> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let mut cc = Command::new(std::env::var_os("CC").unwrap_or_else(|| "cc".into()));
    cc.args(["-std=c11", "-shared", "-fPIC", "-O2", "-I"]).arg(root.join("../include")).arg("-o").arg(folder.join("libbench.so"));
    if !cc.arg(root.join("benches/plugins.c")).status()?.success() {
        return Err("expected a C compiler".into());
    }
    describe_in(folder, "libbench.so")
}

/// What the tests of the SDK load, which Cargo puts beside this.
fn copy_in_rust(folder: &Path) -> Result<PathBuf, Box<dyn Error>> {
    let name = format!("{}sums{}", std::env::consts::DLL_PREFIX, std::env::consts::DLL_SUFFIX);
    std::fs::copy(std::env::current_exe()?.with_file_name(&name), folder.join(&name))?;
    describe_in(folder, &name)
}

fn node(manifest: &Path, isolation: Isolation, id: &str) -> Result<NodeType, Box<dyn Error>> {
    let mut registry = Registry::new().value::<Clip>().with_isolation(isolation);
    find(manifest).remove(0)?.register(&mut registry)?;
    Ok(registry.get(id).ok_or("expected the node")?.clone())
}

/// The plugin's node built in, if it is one in Rust.
fn built_in(id: &str) -> Option<NodeType> {
    Registry::new().per_frame::<SumsNext>().per_frame::<SumsBlend>().per_frame::<SumsJoin>().get(id).cloned()
}

/// Values at all inputs that take some, `several` at one that takes a list, and the defaults of settings.
fn args(node: &NodeType, value: &ValueRef, several: usize) -> Result<Vec<Arg>, Box<dyn Error>> {
    let one = |input: &InputSchema| -> Result<Arg, Box<dyn Error>> {
        Ok(match (&input.ty, input.default) {
            _ if input.list => Arg::List(vec![Arg::Value(value.clone()); several]),
            (InputType::Setting { .. }, text) => {
                Arg::Literal((input.parse)(text.unwrap_or("None"), &Place::default()).map_err(|e| e.message)?.0)
            }
            _ => Arg::Value(value.clone()),
        })
    };
    node.schema.inputs.iter().map(one).collect()
}

/// The time of `count` tasks, each.
fn time(node: &NodeType, args: &[Arg], count: u32) -> Result<Duration, Box<dyn Error>> {
    let clock = Clock { name: "frames".to_owned(), first: 1, last: 1, fps: (24, 1) };
    let cancel = Cancel::default();
    let cx = Context { frame: 1, clock: &clock, input_clocks: &[], cancel: &cancel };
    let all: Vec<Vec<Arg>> = (0..count).map(|_| args.to_vec()).collect();
    let began = Instant::now();
    for args in all {
        node.operator.compute(args, None, &cx)?;
    }
    Ok(began.elapsed() / count)
}

/// The least times of a task, one for each node.
fn least(nodes: &[NodeType], several: usize, value: &ValueRef, (count, rounds): (u32, u32)) -> Result<Vec<Duration>, Box<dyn Error>> {
    let args = nodes.iter().map(|node| args(node, value, several)).collect::<Result<Vec<_>, _>>()?;
    let mut least = vec![Duration::MAX; nodes.len()];
    for _ in 0..rounds {
        for ((least, node), args) in least.iter_mut().zip(nodes).zip(&args) {
            *least = (*least).min(time(node, args, count)?);
        }
    }
    Ok(least)
}

fn main() -> Result<(), Box<dyn Error>> {
    serve_if_asked();
    let folder = tempfile::tempdir()?;
    let (c, rust) = (build_in_c(folder.path())?, copy_in_rust(folder.path())?);
    let piped = Workers { pipes: true, ..Workers::new(own_program().ok_or("expected a program that serves")?) };
    let ways = [Isolation::Off, Isolation::Auto, Isolation::Workers(Box::new(piped))];
    let numbers: ValueRef = Arc::new(Vector { values: vec![1.0, 2.0] });
    let calls = [
        ("C, one input", &c, "bench.next", 1),
        ("Rust, one input", &rust, "sums.next", 1),
        ("Rust, six inputs", &rust, "sums.blend", 1),
        ("Rust, six, a list in them", &rust, "sums.join", 1),
        ("Rust, ten references", &rust, "sums.join", 5),
    ];
    for (name, manifest, id, several) in calls {
        let mut nodes = ways.iter().map(|way| node(manifest, way.clone(), id)).collect::<Result<Vec<_>, _>>()?;
        nodes.extend(built_in(id));
        let times = least(&nodes, several, &numbers, (200, 60))?;
        for (way, time) in ["in process", "isolated", "over sockets", "built in"].iter().zip(times) {
            print!("{way} {time:>9.2?}   ");
        }
        println!("{name}");
    }
    // After the first node the memory that is shared is there.
    let data = (0..4 * 1080 * 1920).map(|i| (i % 1000) as f32 / 500.0).collect();
    let clip = Clip { planes: NdArray::new([4, 1080, 1920], data).ok_or("expected a picture")? };
    let picture: ValueRef = Arc::new(clip);
    let nodes = ways.iter().map(|way| node(&c, way.clone(), "bench.filter")).collect::<Result<Vec<_>, _>>()?;
    let times = least(&nodes, 1, &picture, (1, 40))?;
    let [here, there, piped] = times[..] else { return Err("expected three ways".into()) };
    let more = |time: Duration| 100.0 * (time.as_secs_f64() / here.as_secs_f64() - 1.0);
    let (isolated, sockets) = (more(there), more(piped));
    print!("{:<26} in process {here:>10.2?}   isolated {there:>10.2?} {isolated:+.1} %", "filter of 1920x1080x4");
    println!("   over sockets {piped:>10.2?} {sockets:+.1} %");
    Ok(())
}
