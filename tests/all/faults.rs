//! Faults at the command line, on the real binary: kills, full and vanishing folders, clocks, several runs at once, files that change. After each of
//! them the same command gives the bits of a run that nothing disturbed.
//!
//! By hand, for many kills of a whole graph: `PEGBAR_KILLS=200 PEGBAR_KILLED=target/release/pegbar cargo test --test all faults::killed`.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, UNIX_EPOCH};

use serde_json::Value;

use crate::support::shot::Shot;
use crate::support::{root, walk};

/// A plate on twos, tracked, held, cleaned and laid over: every kind of node, and sinks of every kind.
const NODES: &str = r#""plate": (type: "io.read_images", path: "p.####.png"), "scene": (type: "cel.scene", scene: ball, size: (96, 64), hold: 2),
    "soft": (type: "image.blur", image: "@plate", size: (6, 6)),
    "track": (type: "track.affine", image: "@plate", matte: "@scene.matte"),
    "holds": (type: "time.find_holds", image: "@plate"),
    "clean": (type: "image.clean_plate", image: "@plate", matte: "@scene.matte"),
    "held": (type: "retime.apply", stream: "@soft", map: "@holds"),
    "moved": (type: "image.warp_affine", image: "@scene", motion: "@track.motion"),
    "comp": (type: "comp.over", fg: "@moved", bg: "@held"),
    "last": (type: "comp.over", fg: "@moved", bg: "@clean", opacity: 0.5),
    "out": (type: "io.write_images", image: "@comp", path: "$out/o.####.png"),
    "mix": (type: "io.write_images", image: "@last", path: "$out/m.####.exr"),
    "table": (type: "io.write_table", values: ["@track.motion", "@holds.drawing"], names: ["motion", "drawing"], path: "$out/t.csv"),"#;
const FRAMES: i64 = 16;

/// The graph of [`NODES`] as `g.ron`, and the plate that it reads.
fn shot() -> Shot {
    let plate = r#""scene": (type: "cel.scene", scene: ball, size: (96, 64), grain: 4.0, hold: 2),
        "opaque": (type: "image.shuffle", image: "@scene", channels: ["R", "G", "B"]),
        "out": (type: "io.write_images", image: "@opaque", path: "$out/p.####.png"),"#;
    let shot = Shot::new(FRAMES, plate);
    let ran = Run::of(&shot).args(&["--no-cache", "--out", "."]).end();
    assert_eq!(ran.code, Some(0), "{}", ran.err);
    shot.graph(FRAMES, NODES);
    shot
}

/// A run that is to be started.
struct Run {
    command: Command,
    folder: PathBuf,
}

/// What a run left behind.
struct Ran {
    code: Option<i32>,
    out: String,
    err: String,
}

/// The environment of these tests names neither a cache nor a home.
fn pegbar(binary: &str) -> Command {
    let mut command = Command::new(binary);
    for name in ["HOME", "XDG_CACHE_HOME", "PEGBAR_CACHE", "LOCALAPPDATA"] {
        command.env_remove(name);
    }
    command.stdout(Stdio::piped()).stderr(Stdio::piped());
    command
}

impl Run {
    /// `pegbar run g.ron --progress json` in the folder of the graph.
    fn of(shot: &Shot) -> Self {
        Self::graph(env!("CARGO_BIN_EXE_pegbar"), &shot.path("g.ron"), &shot.path("."))
    }

    fn graph(binary: &str, graph: &Path, folder: &Path) -> Self {
        let mut command = pegbar(binary);
        command.arg("run").arg(graph).args(["--progress", "json", "--threads", "2"]).current_dir(folder);
        Self { command, folder: folder.to_owned() }
    }

    fn args(mut self, args: &[&str]) -> Self {
        self.command.args(args);
        self
    }

    /// Into `out`, with the cache `cache`, which keeps everything.
    fn to(self, out: &str) -> Self {
        self.args(&["--out", out, "--cache", "cache", "--keep", "always"])
    }

    fn env(mut self, name: &str, value: &str) -> Self {
        self.command.env(name, value);
        self
    }

    fn start(mut self) -> Child {
        self.command.spawn().unwrap()
    }

    fn end(self) -> Ran {
        end(self.start())
    }

    /// Does something once the files below `folder` have so many bytes, while the run goes on; or when it has ended.
    fn meanwhile(self, folder: &str, bytes: u64, act: impl FnOnce(&mut Child)) -> Ran {
        let folder = self.folder.join(folder);
        let mut child = self.start();
        while size(&folder) < bytes && child.try_wait().unwrap().is_none() {
            std::thread::yield_now();
        }
        act(&mut child);
        end(child)
    }
}

fn end(child: Child) -> Ran {
    let ended = child.wait_with_output().unwrap();
    let text = |bytes: &[u8]| String::from_utf8_lossy(bytes).into_owned();
    Ran { code: ended.status.code(), out: text(&ended.stdout), err: text(&ended.stderr) }
}

impl Ran {
    fn events(&self) -> Vec<Value> {
        self.out.lines().filter_map(|line| serde_json::from_str(line).ok()).collect()
    }

    /// Tasks that ran, by node.
    fn tasks(&self) -> BTreeMap<String, u64> {
        let finished = self.events().into_iter().rfind(|e| e["event"] == "finished").unwrap_or_else(|| panic!("no end:\n{}", self.err));
        let node = |n: &Value| (n["node"].as_str().unwrap().to_owned(), n["tasks"].as_u64().unwrap());
        finished["nodes"].as_array().unwrap().iter().map(node).collect()
    }

    /// Nodes that were said to be done.
    fn done(&self) -> Vec<String> {
        let done = |e: &Value| (e["event"] == "node_done").then(|| e["node"].as_str().unwrap().to_owned());
        self.events().iter().filter_map(done).collect()
    }

    /// It succeeded, with so many warnings and nothing else said.
    fn fine(&self, what: &str, warnings: usize) -> &Self {
        assert!(self.code == Some(0), "{what}: expected success, found {:?}:\n{}", self.code, self.err);
        let said = self.err.lines().filter(|l| !l.trim().is_empty());
        assert!(said.clone().count() == warnings && said.clone().all(|l| l.starts_with("warning: ")), "{what}:\n{}", self.err);
        self
    }
}

/// Every file below a folder with its bytes, by its path there; none while another process takes them away.
fn files(folder: &Path) -> BTreeMap<String, Vec<u8>> {
    let mut found = BTreeMap::new();
    walk(folder, &mut |path| {
        if let Ok(bytes) = std::fs::read(path) {
            found.insert(path.strip_prefix(folder).unwrap().to_string_lossy().into_owned(), bytes);
        }
    });
    found
}

/// Bytes of all files below a folder, which others may be changing.
fn size(folder: &Path) -> u64 {
    let entries = std::fs::read_dir(folder).into_iter().flatten().flatten();
    entries.map(|e| e.metadata().map_or(0, |m| if m.is_dir() { size(&e.path()) } else { m.len() })).sum()
}

fn is_temporary(name: &str) -> bool {
    name.ends_with(".part")
}

/// What a run gives that nothing disturbs.
fn undisturbed(shot: &Shot) -> BTreeMap<String, Vec<u8>> {
    let ran = Run::of(shot).args(&["--out", "good", "--no-cache"]).end();
    ran.fine("undisturbed", 0);
    let good = files(&shot.path("good"));
    assert_eq!(good.len(), 2 * FRAMES as usize + 1);
    good
}

/// The files in the folder `out` of the graph are these, to the bit, and no others.
fn same(what: &str, shot: &Shot, out: &str, good: &BTreeMap<String, Vec<u8>>) {
    let found = files(&shot.path(out));
    let names = |f: &BTreeMap<String, Vec<u8>>| f.keys().cloned().collect::<Vec<_>>();
    assert_eq!(names(&found), names(good), "{what}");
    good.iter().for_each(|(name, bytes)| assert!(found[name] == *bytes, "{what}: {name} has other bits"));
}

fn cache(shot: &Shot, args: &[&str]) -> Ran {
    end(pegbar(env!("CARGO_BIN_EXE_pegbar"))
        .arg("cache")
        .args(args)
        .args(["--cache", "cache"])
        .current_dir(shot.path("."))
        .spawn()
        .unwrap())
}

/// Numbers that are as good as random, the same in each run.
struct Dice(u64);

impl Dice {
    fn next(&mut self, below: u64) -> u64 {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        self.0 % below.max(1)
    }
}

/// Kills runs of a graph when they have written some share of what a whole one writes, and takes them up again.
fn kill_again_and_again(binary: &str, graph: &Path, folder: &Path, kills: usize) {
    let (out, cached) = (folder.join("out"), folder.join("cache"));
    let run = || Run::graph(binary, graph, folder).to("out");
    let whole = run().end();
    whole.fine("the first", 0);
    let (good, all, bytes) = (files(&out), whole.tasks(), size(&out) + size(&cached));
    let mut dice = Dice(0x9E37_79B9_7F4A_7C15);
    let mut killed = 0;
    for trial in 0..kills {
        std::fs::remove_dir_all(&out).unwrap();
        std::fs::remove_dir_all(&cached).unwrap();
        let at = size(folder) + dice.next(bytes);
        let ran = run().meanwhile(".", at, |child| child.kill().unwrap());
        killed += usize::from(ran.code.is_none());
        let found = files(&out);
        for (name, bytes) in found.iter().filter(|(name, _)| !is_temporary(name)) {
            assert!(good.get(name) == Some(bytes), "kill {trial}: {name} is no whole file of the graph");
        }
        let whole = found.keys().filter(|name| !is_temporary(name)).count() as u64;
        let then = run().end();
        then.fine(&format!("after kill {trial}"), 0);
        assert!(files(&out) == good, "after kill {trial}: other files, or other bits");
        let tasks = then.tasks();
        for node in ran.done() {
            assert_eq!(tasks.get(&node), None, "after kill {trial}: `{node}` was done");
        }
        // Each of the two threads may have been between a file and the note that it is there.
        let sinks: u64 = ["out", "mix", "table", "frames", "sheet", "chart", "curves"].iter().filter_map(|n| tasks.get(*n)).sum();
        assert!(
            sinks + whole <= good.len() as u64 + 2,
            "after kill {trial}: {whole} of {} files were there, {sinks} were made",
            good.len()
        );
        assert!(tasks.iter().all(|(node, n)| *n <= all[node]), "after kill {trial}: {tasks:?}, of {all:?} in a whole run");
        assert_eq!(std::fs::read_dir(cached.join("v1/tmp")).unwrap().count(), 0, "after kill {trial}: what it left is swept");
    }
    assert!(killed * 2 > kills, "{killed} of {kills} were killed before they ended");
}

#[test]
fn killed_runs_are_taken_up_where_they_were_with_whole_files_at_every_moment() {
    let shot = shot();
    match std::env::var("PEGBAR_KILLS").ok().and_then(|n| n.parse().ok()) {
        None => kill_again_and_again(env!("CARGO_BIN_EXE_pegbar"), &shot.path("g.ron"), &shot.path("."), 10),
        Some(kills) => {
            let binary = std::env::var("PEGBAR_KILLED").unwrap_or_else(|_| env!("CARGO_BIN_EXE_pegbar").to_owned());
            let binary = root().join(binary).to_string_lossy().into_owned();
            kill_again_and_again(&binary, &root().join("examples/hat/hat.ron"), &shot.path("."), kills);
        }
    }
}

#[test]
fn a_collection_that_is_killed_leaves_a_cache_that_gives_right_results() {
    let shot = shot();
    let good = undisturbed(&shot);
    Run::of(&shot).to("out").end().fine("first", 0);
    let mut dice = Dice(7);
    for trial in 0..6 {
        let at = size(&shot.path("cache")) - dice.next(size(&shot.path("cache")) / 2);
        let mut child = pegbar(env!("CARGO_BIN_EXE_pegbar"))
            .args(["cache", "gc", "--to", "1000", "--cache", "cache"])
            .current_dir(shot.path("."))
            .spawn()
            .unwrap();
        while size(&shot.path("cache")) > at && child.try_wait().unwrap().is_none() {
            std::thread::yield_now();
        }
        child.kill().unwrap();
        child.wait().unwrap();
        Run::of(&shot).to(&format!("out{trial}")).end().fine("after it", 0);
        same("after it", &shot, &format!("out{trial}"), &good);
        // What was removed before its record was written is found missing once.
        cache(&shot, &["verify"]);
        assert_eq!(cache(&shot, &["verify"]).code, Some(0));
    }
}

/// A file system of its own, gone with the value.
struct Mount(PathBuf);

impl Mount {
    /// `None` where this process may not mount anything; the test then says that it was skipped.
    fn new(folder: PathBuf, options: &str) -> Option<Self> {
        std::fs::create_dir_all(&folder).unwrap();
        let mounted = Command::new("mount").args(["-t", "tmpfs", "-o", options, "tmpfs"]).arg(&folder).output();
        if mounted.is_ok_and(|o| o.status.success()) {
            return Some(Self(folder));
        }
        eprintln!("skipped: no file system may be mounted here");
        None
    }
}

impl Drop for Mount {
    fn drop(&mut self) {
        let _ = Command::new("umount").arg("-l").arg(&self.0).status();
    }
}

#[test]
fn a_cache_on_a_full_disk_is_one_warning_and_an_output_folder_on_one_is_an_error() {
    let shot = shot();
    let good = undisturbed(&shot);
    let Some(full) = Mount::new(shot.path("cache"), "size=400k") else { return };
    for out in ["first", "second"] {
        Run::of(&shot).to(out).end().fine("a full cache", 1);
        same("a full cache", &shot, out, &good);
    }
    cache(&shot, &["verify"]).fine("a full cache", 0);
    drop(full);
    let Some(full) = Mount::new(shot.path("out"), "size=200k") else { return };
    let ran = Run::of(&shot).to("out").end();
    let there = files(&shot.path("out"));
    assert!(ran.code == Some(1) && ran.err.contains("No space left on device") && !ran.err.contains("panicked"), "{}", ran.err);
    assert!(there.iter().all(|(name, bytes)| good[name] == *bytes) && !there.is_empty(), "whole files alone: {:?}", there.keys());
    drop(full);
    // What was made before the disk was full is taken from the cache.
    let then = Run::of(&shot).to("out").end();
    assert_eq!(then.fine("with room", 0).tasks().get("track"), None);
    same("with room", &shot, "out", &good);
}

#[test]
fn values_that_fit_neither_memory_nor_disk_are_one_error() {
    let shot = shot();
    let good = undisturbed(&shot);
    // The clean plate reads all frames of the plate, which are more than that.
    let small = || Run::of(&shot).args(&["--out", "out", "--cache", "spill", "--no-cache", "--memory", "1500kB", "--only", "mix"]);
    small().end().fine("with room on the disk", 0);
    assert!(files(&shot.path("out")).iter().all(|(name, bytes)| good[name] == *bytes));
    let Some(full) = Mount::new(shot.path("spill"), "size=100k") else { return };
    let ran = small().end();
    drop(full);
    let errors = ran.err.matches("error[").count();
    assert!(ran.code == Some(1) && !ran.err.contains("panicked"), "{:?}\n{}", ran.code, ran.err);
    // One for each node that found no room, whatever its frames.
    assert!((1..=3).contains(&errors) && ran.err.matches("No space left on device").count() == errors, "{}", ran.err);
}

#[test]
fn a_folder_that_is_no_cache_is_one_warning() {
    let shot = shot();
    let good = undisturbed(&shot);
    shot.put("cache", b"precious");
    Run::of(&shot).to("file").end().fine("a file in its place", 1);
    same("a file in its place", &shot, "file", &good);
    assert_eq!(shot.get("cache"), b"precious");
    let nowhere = shot.path("cache/below").to_string_lossy().into_owned();
    let run = |out: &str| Run::of(&shot).args(&["--out", out, "--memory", "1500kB"]);
    run("nowhere").env("PEGBAR_CACHE", &nowhere).end().fine("a folder that cannot be made", 1);
    same("a folder that cannot be made", &shot, "nowhere", &good);
    // Nobody named one, and there is no home.
    run("homeless").end().fine("no home", 0);
    same("no home", &shot, "homeless", &good);
}

#[test]
fn a_cache_that_goes_away_under_a_run_is_one_warning() {
    let shot = shot();
    let good = undisturbed(&shot);
    let folder = shot.path("cache");
    let gone = |what: &str, act: &dyn Fn()| {
        let ran = Run::of(&shot).to(what).meanwhile("cache", 300_000, |_| act());
        ran.fine(what, 1);
        same(what, &shot, what, &good);
        drop(std::fs::remove_file(&folder));
        drop(std::fs::remove_dir_all(&folder));
    };
    let away = || while std::fs::remove_dir_all(&folder).is_err() {};
    gone("removed", &away);
    gone("moved away", &|| std::fs::rename(&folder, shot.path("elsewhere")).unwrap());
    gone("a file in its place", &|| {
        away();
        std::fs::write(&folder, "x").unwrap();
    });
    // A file system cannot turn read-only while a file is open to be written, but another can be laid over it.
    let mut over = None;
    let ran = Run::of(&shot).to("hidden").meanwhile("cache", 300_000, |_| over = Mount::new(folder.clone(), "ro"));
    if over.take().is_some() {
        ran.fine("hidden", 1);
        same("hidden", &shot, "hidden", &good);
        Run::of(&shot).to("hidden").end().fine("there again", 0);
        same("there again", &shot, "hidden", &good);
    }
}

/// Sets the time of the last change of every file below a folder.
fn set_times(folder: &Path, seconds: u64) {
    let time = UNIX_EPOCH + Duration::from_secs(seconds);
    walk(folder, &mut |path| std::fs::File::options().append(true).open(path).unwrap().set_modified(time).unwrap());
}

#[test]
fn no_clock_is_believed() {
    let shot = shot();
    let good = undisturbed(&shot);
    Run::of(&shot).to("out").end().fine("first", 0);
    for time in [1_000_000_000, 4_100_000_000, 0] {
        // Inputs, outputs and cache alike.
        set_times(&shot.path("."), time);
        let ran = Run::of(&shot).to("out").end();
        assert!(ran.fine("touched", 0).tasks().is_empty(), "{time}: touched, and nothing else");
        same("touched", &shot, "out", &good);
    }
    // Another content with the old time and length is another file.
    let (first, other) = (shot.get("p.0001.png"), shot.get("p.0003.png"));
    shot.put("p.0001.png", &other);
    set_times(&shot.path("."), 0);
    let ran = Run::of(&shot).to("out").end();
    assert_eq!(ran.fine("another plate", 0).tasks().get("plate"), Some(&1));
    Run::of(&shot).args(&["--out", "other", "--no-cache"]).end().fine("another plate", 0);
    same("another plate", &shot, "out", &files(&shot.path("other")));
    shot.put("p.0001.png", &first);
    Run::of(&shot).to("out").end().fine("the first again", 0);
    same("the first again", &shot, "out", &good);
}

#[test]
fn runs_at_once_share_an_output_folder_and_a_cache() {
    let shot = shot();
    let good = undisturbed(&shot);
    for n in [2, 4] {
        let out = format!("out{n}");
        let children: Vec<Child> = (0..n).map(|_| Run::of(&shot).to(&out).start()).collect();
        for child in children {
            end(child).fine("at once", 0);
        }
        same("at once", &shot, &out, &good);
        cache(&shot, &["verify"]).fine("after them", 0);
        std::fs::remove_dir_all(shot.path("cache")).unwrap();
    }
}

#[test]
fn a_cache_that_others_cut_down_under_a_run_costs_no_bit() {
    let shot = shot();
    let good = undisturbed(&shot);
    for (i, args) in [&["gc", "--to", "0"][..], &["clear"]].into_iter().enumerate() {
        Run::of(&shot).to("warm").end().fine("warm", 0);
        let out = format!("out{i}");
        let mut child = Run::of(&shot).to(&out).start();
        while child.try_wait().unwrap().is_none() {
            cache(&shot, args);
        }
        let ran = end(child);
        assert!(ran.code == Some(0) && ran.err.lines().count() <= 1, "{args:?}: {:?}\n{}", ran.code, ran.err);
        same("cut down", &shot, &out, &good);
    }
}

#[test]
fn an_input_that_changes_under_a_run_poisons_nothing() {
    let shot = shot();
    let good = undisturbed(&shot);
    let name = "p.0007.png";
    let (one, two) = (shot.get(name), shot.get("p.0011.png"));
    let mut refused = 0;
    for trial in 0..8 {
        let in_place = trial % 2 == 0;
        let mut child = Run::of(&shot).to("out").start();
        while child.try_wait().unwrap().is_none() {
            for bytes in [&two, &one] {
                if in_place {
                    shot.put(name, bytes);
                } else {
                    shot.put("next", bytes);
                    std::fs::rename(shot.path("next"), shot.path(name)).unwrap();
                }
            }
        }
        let ran = end(child);
        if ran.code != Some(0) {
            refused += 1;
            assert!(ran.err.contains(name) && !ran.err.contains("panicked"), "{}", ran.err);
        }
        // It ends as it began, and what was kept meanwhile is right.
        Run::of(&shot).to("out").end().fine("with the writer gone", 0);
        same("with the writer gone", &shot, "out", &good);
        if trial % 4 == 3 {
            std::fs::remove_dir_all(shot.path("cache")).unwrap();
            std::fs::remove_dir_all(shot.path("out")).unwrap();
        }
    }
    eprintln!("{refused} of 8 were refused");
}

#[test]
fn outputs_that_were_spoilt_are_made_again_and_nothing_else() {
    let shot = shot();
    let good = undisturbed(&shot);
    let run = || Run::of(&shot).to("out");
    run().end().fine("first", 0);
    type Spoil<'a> = (&'a str, &'a dyn Fn(&Path));
    let spoil: [Spoil; 4] = [
        ("deleted", &|path| std::fs::remove_file(path).unwrap()),
        ("empty", &|path| std::fs::write(path, b"").unwrap()),
        ("cut", &|path| std::fs::write(path, &std::fs::read(path).unwrap()[..40]).unwrap()),
        ("changed", &|path| {
            let mut bytes = std::fs::read(path).unwrap();
            bytes[60] ^= 1;
            std::fs::write(path, bytes).unwrap();
        }),
    ];
    for (what, spoil) in spoil {
        spoil(&shot.path("out/o.0005.png"));
        let ran = run().end();
        assert_eq!(ran.fine(what, 0).tasks(), BTreeMap::from([("out".to_owned(), 1)]), "{what}");
        same(what, &shot, "out", &good);
    }
    for name in ["p.0003.png", "out/o.0003.png", "out/t.csv"] {
        let file = std::fs::File::options().append(true).open(shot.path(name)).unwrap();
        file.set_modified(std::time::SystemTime::now()).unwrap();
        assert!(run().end().fine(name, 0).tasks().is_empty(), "{name} was touched, and no more");
    }
    let ran = run().args(&["--set", "mix.compression=none"]).end();
    assert_eq!(ran.fine("the last node", 0).tasks(), BTreeMap::from([("mix".to_owned(), FRAMES as u64)]));
    run().end().fine("as it was", 0);
    same("as it was", &shot, "out", &good);
}

#[test]
fn a_cache_that_is_damaged_everywhere_is_told_and_mended() {
    let shot = shot();
    let good = undisturbed(&shot);
    Run::of(&shot).to("first").end().fine("first", 0);
    let mut dice = Dice(99);
    for round in 0..4 {
        walk(&shot.path("cache/v1"), &mut |path| {
            let mut bytes = std::fs::read(path).unwrap();
            for _ in 0..bytes.len().div_ceil(20_000) {
                let at = dice.next(bytes.len() as u64) as usize;
                bytes[at] ^= 1 << dice.next(8);
            }
            std::fs::write(path, bytes).unwrap();
        });
        let out = format!("out{round}");
        let ran = Run::of(&shot).to(&out).end();
        assert!(ran.code == Some(0) && ran.err.lines().all(|l| l.starts_with("warning: ")), "{:?}\n{}", ran.code, ran.err);
        assert!(!ran.err.is_empty(), "damage is told");
        same("damaged", &shot, &out, &good);
        cache(&shot, &["verify"]);
        let verified = cache(&shot, &["verify"]);
        assert!(verified.code == Some(0) && verified.out.contains(" 0 removed"), "{}\n{}", verified.out, verified.err);
        let ran = Run::of(&shot).to(&out).end();
        assert_eq!(ran.code, Some(0));
        same("mended", &shot, &out, &good);
    }
}
