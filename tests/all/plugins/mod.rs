//! Plugins: what is refused and how it is said, what breaks its contract at run time, locks and versions, and that listing loads no code.

mod check;
mod hostile;
mod scaffold;

use std::path::{Path, PathBuf};

use pegbar_engine::plugin::{Isolation, Manifest, Workers, describe};

use crate::support::plugins::{compile, compile_by, examples, library_name, write_manifest};
use crate::support::root;
use crate::support::shot::{Ran, Shot, cli, cli_in, workers};

const NODES: &str = r#""a": (type: "motion.keys", keys: [(1.0, 1.0), (4.0, 4.0)]),"#;

/// Each of these tests as three: with plugins in this process, and in workers that are reached over memory that is shared, or over sockets.
macro_rules! both_ways {
    ($($name:ident),* $(,)?) => {
        mod in_process {
            $(#[test]
            fn $name() {
                super::$name(&super::Isolation::Off);
            })*
        }
        mod isolated {
            $(#[test]
            fn $name() {
                super::$name(&super::Isolation::Workers(Box::new(super::workers())));
            })*
        }
        mod piped {
            $(#[test]
            fn $name() {
                super::$name(&super::Isolation::Workers(Box::new(super::Workers { pipes: true, ..super::workers() })));
            })*
        }
    };
}

both_ways!(
    a_library_that_is_not_what_its_manifest_says_is_refused,
    what_breaks_the_contract_is_one_error_that_names_plugin_and_node,
    what_is_thrown_in_c_plus_plus_is_an_error,
    plugins_of_the_first_release_run_for_ever,
    a_plugin_whose_digest_changes_runs_again,
);

/// A folder with the odd plugin, built with `defines`, and a graph of four frames.
struct Odd {
    shot: Shot,
    library: PathBuf,
    isolation: Isolation,
}

impl Odd {
    fn build(defines: &[&str]) -> Self {
        let shot = Shot::new(4, NODES);
        let library = shot.path(&library_name("odd"));
        compile(&root().join("tests/all/plugins/odd.c"), "plugins/include", defines, &library);
        Self { shot, library, isolation: Isolation::Off }
    }

    fn new() -> Self {
        let odd = Self::build(&[]);
        write_manifest(&odd.library);
        odd
    }

    fn running(isolation: &Isolation) -> Self {
        Self { isolation: isolation.clone(), ..Self::new() }
    }

    /// Builds another library for the manifest that is there. A process never loads two libraries from one path.
    fn rebuild(&mut self, defines: &[&str]) {
        self.library = self.shot.path(&library_name("odd_again"));
        compile(&root().join("tests/all/plugins/odd.c"), "plugins/include", defines, &self.library);
        self.edit(|text| text.replace(&library_name("odd"), &library_name("odd_again")));
    }

    fn manifest(&self) -> PathBuf {
        self.shot.path("odd.plugin.ron")
    }

    /// The manifest changed.
    fn edit(&self, edit: impl FnOnce(String) -> String) {
        let text = std::fs::read_to_string(self.manifest()).unwrap();
        std::fs::write(self.manifest(), edit(text)).unwrap();
    }

    fn command(&self, before: &[&str], after: &[&str]) -> Ran {
        let (graph, out, manifest) = (self.shot.path("g.ron"), self.shot.path("out"), self.manifest());
        let mut args = before.to_vec();
        args.extend([graph.to_str().unwrap(), "--out", out.to_str().unwrap(), "--plugins", manifest.to_str().unwrap()]);
        args.extend(after);
        let ran = cli_in(&self.isolation, &args);
        let folder = self.shot.path("");
        let plain = |text: String| text.replace(folder.to_str().unwrap(), "");
        Ran { code: ran.code, out: plain(ran.out), err: plain(ran.err) }
    }

    /// Runs the graph with `odd.vector` going its way.
    fn run(&self, way: &str) -> Ran {
        let odd = format!("\"odd\": (type: \"odd.vector\", vector: [1.0, 2.0], way: {way:?}),");
        self.shot.graph(4, &format!("{odd} \"out\": (type: \"io.write_value\", value: \"@odd\", path: \"$out/odd.npz\"),"));
        self.command(&["run"], &["--progress", "none", "--no-cache"])
    }
}

/// The error lines of a run.
fn errors(ran: &Ran) -> Vec<String> {
    ran.err.lines().filter(|l| l.starts_with("error")).map(str::to_owned).collect()
}

#[test]
fn libraries_that_are_no_plugins_for_this_host_are_refused() {
    let size = 64;
    let cases: [(&[&str], &str); 5] = [
        (&["MAJOR=2"], "expected a plugin for ABI 1, found one for ABI 2"),
        (&["MAJOR=0"], "expected a plugin for ABI 1, found one for ABI 0"),
        (&["SIZE=16"], &format!("expected a PbPlugin of at least {size} bytes, found 16")),
        (&["NO_ENTRY"], "expected a plugin that exports `pb_plugin_entry`, found none"),
        (&["REFUSES"], "expected a plugin for this host (pegbar 0.1.0 with ABI 1.0), found one that will not work with it"),
    ];
    for (defines, expected) in cases {
        let odd = Odd::build(defines);
        let error = describe(&odd.library).unwrap_err().message;
        assert_eq!(error, format!("library {}: {expected}", odd.library.display()), "{defines:?}");
    }
    let shot = Shot::new(1, "");
    shot.put("libtext.so", b"no library");
    let error = describe(&shot.path("libtext.so")).unwrap_err().message;
    assert!(error.contains("expected a shared library, found ") && error.contains("libtext.so"), "{error}");
    let error = describe(&shot.path("libnone.so")).unwrap_err().message;
    assert!(error.contains("libnone.so: No such file"), "{error}");
}

fn a_library_that_is_not_what_its_manifest_says_is_refused(isolation: &Isolation) {
    let mut odd = Odd::running(isolation);
    odd.rebuild(&["DOC=\"Changed.\""]);
    let ran = odd.run("well");
    assert_eq!(ran.code, 1);
    let said = errors(&ran);
    assert_eq!(said.len(), 1, "{}", ran.err);
    let digests =
        ["error[PB0503]: node `odd` failed: plugin `odd` 1.0.0: expected the library", "of digest", "as its manifest says, found"];
    assert!(digests.iter().all(|part| said[0].contains(part)), "{}", ran.err);
    assert!(ran.err.contains("help: `pegbar plugin manifest") && ran.err.contains("g.ron"), "{}", ran.err);

    // With the digest of the new library it is the schema that differs.
    let digest = pegbar_engine::plugin::digest(&odd.library).unwrap();
    let old = Manifest::read(&odd.manifest()).unwrap().libraries.into_values().next().unwrap().digest;
    odd.edit(|text| text.replace(&old, &digest));
    let said = errors(&odd.run("well")).join("\n");
    let expected =
        "node `odd` failed: plugin `odd` 1.0.0: doc: expected Breaks its contract., as its manifest says, found Changed. in the library";
    assert!(said.contains(expected), "{said}");

    odd.edit(|text| text.replace("\"Breaks its contract.\"", "\"Changed.\"").replace("How.", "Why."));
    let said = errors(&odd.run("well")).join("\n");
    assert!(said.contains("plugin `odd` 1.0.0: nodes `odd.vector`: expected ") && said.contains("Why.") && said.contains("How."), "{said}");

    odd.edit(|text| text.replace("Why.", "How.").replace("(1, 0)", "(2, 0)"));
    let said = errors(&odd.run("well")).join("\n");
    assert!(said.contains("plugin `odd` 1.0.0: abi: expected 2.0, as its manifest says, found 1.0 in the library"), "{said}");
    std::fs::remove_file(&odd.library).unwrap();
    let said = errors(&odd.run("well")).join("\n");
    assert!(said.contains("node `odd` failed: plugin `odd` 1.0.0: library "), "{said}");
}

fn what_breaks_the_contract_is_one_error_that_names_plugin_and_node(isolation: &Isolation) {
    let odd = Odd::running(isolation);
    let output = "plugin `odd` 1.0.0: output `vector`:";
    let cases = [
        ("status", "plugin `odd` 1.0.0: expected a reason for its failure, found status 1 alone".to_owned()),
        ("strange status", "plugin `odd` 1.0.0: expected a reason for its failure, found status 77 alone".to_owned()),
        ("stops", "plugin `odd` 1.0.0: expected it to stop only when asked, found it stopped".to_owned()),
        ("no instance", "expected another way, found none".to_owned()),
        ("fails", "expected numbers that add up, found others".to_owned()),
        ("fails quietly", "expected a failure that is not hidden".to_owned()),
        ("missing", format!("{output} expected Vector, found none")),
        ("dtype", format!("{output} array `values`: expected f64 [n], found f32 [2]")),
        ("no dtype", "plugin `odd` 1.0.0: array `values`: expected memory for it, found none".to_owned()),
        ("rank", format!("{output} array `values`: expected f64 [n], found f64 [2, 1]")),
        ("too many axes", "plugin `odd` 1.0.0: array `values`: expected memory for it, found none".to_owned()),
        ("huge", "plugin `odd` 1.0.0: array `values`: expected memory for it, found none".to_owned()),
        ("name", format!("{output} expected the arrays of Vector, found `numbers`")),
        ("output", format!("{output} expected Vector, found none")),
        ("text", "plugin `odd` 1.0.0: text of output 0: expected one JSON object: ".to_owned()),
        ("short block", "plugin `odd` 1.0.0: array `values`: expected f64 [2], found 24 bytes".to_owned()),
        ("twice", "plugin `odd` 1.0.0: array `values` of output 0: expected it once, found it put out twice".to_owned()),
        ("fetch", "plugin `odd` 1.0.0: expected a sequence to fetch from, found port 0".to_owned()),
    ];
    for (way, expected) in cases {
        let ran = odd.run(way);
        let said = errors(&ran);
        assert!(ran.code == 1 && said.len() == 1, "{way}: {}", ran.err);
        // What the plugin refuses is no breach of its contract.
        let code = if expected.starts_with("plugin ") { "PB0503" } else { "PB0500" };
        assert!(said[0].starts_with(&format!("error[{code}]: node `odd` failed: {expected}")), "{way}: {}", ran.err);
        assert!(ran.err.contains("odd.vector"), "{way}: {}", ran.err);
    }
    for way in ["well", "pass"] {
        let ran = odd.run(way);
        assert_eq!(ran.code, 0, "{way}: {}", ran.err);
    }
}

#[test]
fn nothing_but_a_run_loads_a_library() {
    let odd = Odd::new();
    // What is mapped is taken away rather than written over.
    std::fs::remove_file(&odd.library).unwrap();
    std::fs::write(&odd.library, b"no library").unwrap();
    let node = r#""odd": (type: "odd.vector", vector: [1.0]), "out": (type: "io.write_value", value: "@odd", path: "$out/o.npz"),"#;
    odd.shot.graph(4, node);
    for command in ["check", "graph", "plan"] {
        let more: &[&str] = if command == "plan" { &["--no-cache"] } else { &[] };
        let ran = odd.command(&[command], more);
        assert_eq!(ran.code, 0, "{command}: {}", ran.err);
    }
    let manifest = odd.manifest();
    let plugins = ["--plugins", manifest.to_str().unwrap()];
    let nodes = cli(&["nodes", plugins[0], plugins[1]]);
    assert!(nodes.out.contains("\nodd\n  odd.vector "), "{}", nodes.out);
    let explained = cli(&["explain", "odd.vector", plugins[0], plugins[1]]);
    assert!(explained.out.contains("How.") && explained.out.contains("odd 1.0.0"), "{}", explained.out);
}

#[test]
fn a_plugin_that_is_not_there_is_named() {
    let shot = Shot::new(4, r#""odd": (type: "odd.vector", vector: [1.0]),"#);
    let graph = shot.path("g.ron");
    let ran = cli(&["check", graph.to_str().unwrap()]);
    assert_eq!(ran.code, 2);
    assert!(ran.err.contains("error[PB0120]: expected a node type, found `odd.vector`"), "{}", ran.err);
    assert!(ran.err.contains("if it is of a plugin `odd`: name that with --plugins"), "{}", ran.err);
    let ran = cli(&["check", graph.to_str().unwrap(), "--plugins", shot.path("nowhere").to_str().unwrap()]);
    assert!(ran.code == 2 && ran.err.starts_with("error[PB0180]: expected a plugin manifest NAME.plugin.ron"), "{}", ran.err);
    let text = "Graph(pegbar: 1, plugins: [\"../odd\"], nodes: {})";
    shot.put("g.ron", text.as_bytes());
    let ran = cli(&["check", graph.to_str().unwrap()]);
    assert!(ran.code == 2 && ran.err.contains("error[PB0180]") && ran.err.contains("g.ron:1:28"), "{}", ran.err);
}

#[test]
fn a_graph_names_its_plugins_and_a_lock_pins_them() {
    let mut odd = Odd::new();
    let text = r#"Graph(pegbar: 1, plugins: ["odd"], nodes: { "odd": (type: "odd.vector", vector: [1.0]) })"#;
    odd.shot.put("g.ron", text.as_bytes());
    let path = odd.shot.path("g.ron");
    let graph = path.to_str().unwrap();
    assert_eq!(cli(&["check", graph]).code, 0, "{}", cli(&["check", graph]).err);
    let ran = cli(&["plugin", "lock", graph]);
    assert!(ran.code == 0 && ran.out.contains("1 plugin pinned"), "{}{}", ran.out, ran.err);
    assert_eq!(cli(&["check", graph]).code, 0);

    odd.rebuild(&["DOC=\"Changed.\""]);
    write_manifest(&odd.library);
    let ran = cli(&["check", graph]);
    assert!(ran.code == 2 && ran.err.contains("error[PB0182]: expected plugin `odd` 1.0.0 of digest"), "{}", ran.err);
    assert!(ran.err.contains("help: `pegbar plugin lock GRAPH` pins what is there now"), "{}", ran.err);
    assert_eq!(cli(&["plugin", "lock", graph]).code, 0);
    assert_eq!(cli(&["check", graph]).code, 0);
}

#[test]
fn a_library_that_changes_under_a_process_is_seen() {
    let odd = Odd::new();
    compile(&root().join("tests/all/plugins/odd.c"), "plugins/include", &["DOC=\"Changed.\""], &odd.library);
    let error = describe(&odd.library).unwrap_err();
    assert!(error.message.contains("expected the library that this process has loaded from there, of digest"), "{error}");
    assert_eq!(error.help.as_deref(), Some("start Pegbar anew"));
}

/// A copy of a plugin's manifest in a folder of its own, with another version and digest.
fn versioned(odd: &Odd, version: &str, digest: &str) -> PathBuf {
    let folder = odd.shot.path(version);
    std::fs::create_dir(&folder).unwrap();
    let mut manifest = Manifest::read(&odd.manifest()).unwrap();
    manifest.plugin.version = version.to_owned();
    manifest.libraries.values_mut().for_each(|library| library.digest = digest.to_owned());
    let path = folder.join("odd.plugin.ron");
    manifest.write(&path).unwrap();
    path
}

#[test]
fn two_versions_serve_one_graph() {
    let odd = Odd::new();
    let newer = versioned(&odd, "1.2.0", &"2".repeat(64));
    let with = |ty: &str, plugins: &[&Path]| {
        odd.shot.graph(4, &format!("\"a\": (type: \"odd.vector@1.0\", vector: [1.0]), \"b\": (type: {ty:?}, vector: [1.0]),"));
        let path = odd.shot.path("g.ron");
        let mut args = vec!["check", path.to_str().unwrap()];
        plugins.iter().for_each(|p| args.extend(["--plugins", p.to_str().unwrap()]));
        cli(&args)
    };
    let (manifest, both) = (odd.manifest(), [newer.as_path(), &odd.manifest()].map(Path::to_owned));
    let both: Vec<&Path> = both.iter().map(PathBuf::as_path).collect();
    let ran = with("odd.vector@1.2", &both);
    assert_eq!(ran.code, 0, "{}", ran.err);
    let ran = with("odd.vector", &both);
    assert!(ran.err.contains("error[PB0181]: expected the version of the plugin of `odd.vector`"), "{}", ran.err);
    assert!(ran.err.contains("write \"odd.vector@1.2.0\"; there are 1.0.0, 1.2.0"), "{}", ran.err);
    let ran = with("odd.vector@3", &both);
    assert!(ran.err.contains("error[PB0181]: expected one version of the plugin of `odd.vector`, found `odd.vector@3`"), "{}", ran.err);
    let ran = with("odd.vector", &[&manifest]);
    assert_eq!(ran.code, 0, "{}", ran.err);

    // The same name and version twice is fine if it is the same library, and is not if it is another.
    let ran = with("odd.vector", &[&manifest, &manifest]);
    assert_eq!(ran.code, 0, "{}", ran.err);
    let other = versioned(&odd, "1.0.0", &"1".repeat(64));
    let ran = with("odd.vector", &[&manifest, &other]);
    assert!(ran.err.contains("error[PB0180]: plugin `odd` 1.0.0: expected one library of this name and version"), "{}", ran.err);
}

#[test]
fn manifests_that_do_not_hold_together_are_refused() {
    let cases = [
        ("id: \"odd.vector\"", "id: \"comp.over\"", "expected a node id as odd.word, found `comp.over`"),
        (
            "Value(\"Vector\")",
            "Value(\"Victor\")",
            "node `odd.vector`: input `vector`: expected a value type among `values`, found `Victor`",
        ),
        ("kind: per_frame", "kind: recurrent", "node `odd.vector`: expected a state of recurrent nodes, and of no others"),
        ("setting(\"text\")", "setting(\"poem\")", "node `odd.vector`: input `way`: expected a type of settings as `number`, found `poem`"),
        (
            "default: Some(\"\\\"well\\\"\")",
            "default: Some(\"4\")",
            "node `odd.vector`: input `way`: default 4: expected string, found integer",
        ),
        ("version: \"1.0.0\"", "version: \"new\"", "expected a version as 1.2.0, found `new`"),
        ("plugin: ", "plugged: ", "line 8"),
    ];
    for (from, to, expected) in cases {
        let odd = Odd::new();
        odd.edit(|text| {
            let (from, text) = (from.replace("Value(", "value("), text);
            assert!(text.contains(&from), "{from} in {text}");
            text.replacen(&from, &to.replace("Value(", "value("), 1)
        });
        let error = Manifest::read(&odd.manifest()).unwrap_err().message;
        assert!(error.starts_with(&format!("plugin manifest {}: ", odd.manifest().display())) && error.contains(expected), "{error}");
    }
}

fn what_is_thrown_in_c_plus_plus_is_an_error(isolation: &Isolation) {
    let shot = Shot::new(4, "");
    let library = shot.path(&library_name("thrower"));
    compile(&root().join("tests/all/plugins/thrower.cpp"), "plugins/include", &[], &library);
    let manifest = write_manifest(&library);
    let run = |way: &str| {
        let node = format!("\"t\": (type: \"thrower.vector\", vector: [1.0, 2.0], way: {way:?}),");
        shot.graph(4, &format!("{node} \"out\": (type: \"io.write_value\", value: \"@t\", path: \"$out/t.npz\"),"));
        let (graph, out) = (shot.path("g.ron"), shot.path("out"));
        let plugins = ["--plugins", manifest.to_str().unwrap()];
        cli_in(
            isolation,
            &["run", graph.to_str().unwrap(), "--out", out.to_str().unwrap(), "--progress", "none", "--no-cache", plugins[0], plugins[1]],
        )
    };
    assert_eq!(run("well").code, 0, "{}", run("well").err);
    let cases = [
        ("exception", "plugin `thrower` 1.0.0: panicked: thrown by a node"),
        ("number", "plugin `thrower` 1.0.0: panicked: an exception that says nothing"),
        ("constructor", "plugin `thrower` 1.0.0: panicked: thrown by a constructor"),
        ("array", "expected an array `nothing` of another type"),
    ];
    for (way, expected) in cases {
        let said = errors(&run(way));
        let code = if expected.starts_with("plugin ") { "PB0503" } else { "PB0500" };
        assert_eq!(said, [format!("error[{code}]: node `t` failed: {expected}")], "{way}");
    }
}

/// The plugin of the first release, compiled against the header of the first release, as both were.
fn plugins_of_the_first_release_run_for_ever(isolation: &Isolation) {
    let shot = Shot::new(
        2,
        r#""a": (type: "image.constant", size: (8, 6), color: (0.5, 0.5, 0.5, 1.0)), "d": (type: "print.halftone", image: "@a", pitch: 4.0), "out": (type: "io.write_images", image: "@d", path: "$out/d.png"),"#,
    );
    let library = shot.path(&library_name("print"));
    compile(&root().join("plugins/include/v1/halftone.c"), "plugins/include/v1", &[], &library);
    let manifest = write_manifest(&library);
    let (graph, out) = (shot.path("g.ron"), shot.path("out"));
    let ran = cli_in(
        isolation,
        &["run", graph.to_str().unwrap(), "--out", out.to_str().unwrap(), "--no-cache", "--plugins", manifest.to_str().unwrap()],
    );
    assert_eq!(ran.code, 0, "{}", ran.err);
}

/// A result is taken from the cache for as long as the plugin is the one that made it.
fn a_plugin_whose_digest_changes_runs_again(isolation: &Isolation) {
    let mut odd = Odd::running(isolation);
    let node = r#""odd": (type: "odd.vector", vector: [1.0]), "out": (type: "io.write_value", value: "@odd", path: "$out/o.npz"),"#;
    odd.shot.graph(4, node);
    let (cache, trace) = (odd.shot.path("cache"), odd.shot.path("trace.json"));
    let ran = |odd: &Odd| {
        let more = ["--progress", "none", "--keep", "always", "--cache", cache.to_str().unwrap(), "--trace", trace.to_str().unwrap()];
        let ran = odd.command(&["run"], &more);
        assert_eq!(ran.code, 0, "{}", ran.err);
        String::from_utf8(odd.shot.get("trace.json")).unwrap().contains("odd.vector")
    };
    assert!(ran(&odd) && !ran(&odd));
    odd.rebuild(&["DOC=\"Changed.\""]);
    write_manifest(&odd.library);
    assert!(ran(&odd) && !ran(&odd));
}

#[test]
fn the_example_plugins_are_documented_and_their_examples_are_graphs() {
    let nodes = cli(&["nodes", "--format", "json", "--plugins", examples().to_str().unwrap()]);
    assert_eq!(nodes.code, 0, "{}", nodes.err);
    for id in ["paper.bleed", "paper.exposure", "paper.grain", "paper.trail", "print.halftone"] {
        assert!(nodes.out.contains(&format!("\"id\": \"{id}\"")), "{id}");
    }
}

/// Two hundred packages whose libraries are text, or not there at all.
#[test]
fn listing_many_packages_opens_no_library() {
    let odd = Odd::new();
    let text = std::fs::read_to_string(odd.manifest()).unwrap();
    let folder = odd.shot.path("packages");
    std::fs::create_dir(&folder).unwrap();
    for i in 0..200 {
        let (name, library) = (format!("odd{i:03}"), library_name(&format!("odd{i:03}")));
        let package = text.replace(&library_name("odd"), &library).replace("odd.vector", &format!("{name}.vector"));
        std::fs::write(folder.join(format!("{name}.plugin.ron")), package.replace("name: \"odd\"", &format!("name: {name:?}"))).unwrap();
        if i % 2 == 0 {
            std::fs::write(folder.join(library), b"no library").unwrap();
        }
    }
    let ran = cli(&["nodes", "--plugins", folder.to_str().unwrap()]);
    assert_eq!((ran.code, ran.err.as_str()), (0, ""));
    assert_eq!(ran.out.matches(".vector ").count(), 200, "{}", ran.out);
    assert!(ran.out.contains("\nodd199\n  odd199.vector "), "{}", ran.out);
    let ran = cli(&["explain", "odd007.vector", "--plugins", folder.to_str().unwrap()]);
    assert!(ran.code == 0 && ran.out.contains("odd007 1.0.0"), "{}", ran.err);
}

/// Every compiler that is there, at every level of optimisation, makes a plugin of the same bits.
#[test]
fn plugins_of_any_compiler_and_optimisation_give_the_same() {
    let graph = r#""a": (type: "image.checkerboard", size: (41, 23)), "b": (type: "image.blur", image: "@a", size: (5.0, 5.0)),
        "d": (type: "print.halftone", image: "@b", pitch: 4.0, angle_deg: 22.0), "out": (type: "io.write_value", value: "@d", path: "$out/d.npz"),"#;
    let mut made: Vec<(String, Vec<u8>)> = Vec::new();
    for compiler in ["cc", "gcc", "clang"] {
        if std::process::Command::new(compiler).arg("--version").output().is_err() {
            eprintln!("skipped: no {compiler}");
            continue;
        }
        for level in ["-O0", "-O2", "-O3"] {
            let shot = Shot::new(1, graph);
            let library = shot.path(&library_name("print"));
            let source = root().join("plugins/examples/c/halftone.c");
            compile_by(Path::new(compiler), &[level], &source, "plugins/include", &[], &library);
            let (manifest, graph, out) = (write_manifest(&library), shot.path("g.ron"), shot.path("out"));
            let args =
                ["run", graph.to_str().unwrap(), "--out", out.to_str().unwrap(), "--no-cache", "--plugins", manifest.to_str().unwrap()];
            let ran = cli(&args);
            assert_eq!(ran.code, 0, "{compiler} {level}: {}", ran.err);
            made.push((format!("{compiler} {level}"), std::fs::read(out.join("d.npz")).unwrap()));
        }
    }
    let (first, rest) = made.split_first().unwrap();
    assert!(first.1.len() > 1000);
    rest.iter().for_each(|(how, bytes)| assert!(*bytes == first.1, "{how} and {}", first.0));
}

/// A value type that one plugin, in Rust, brings along, and that another, in C, reads.
#[test]
fn a_value_type_of_one_plugin_is_read_by_another() {
    let shot = Shot::new(
        3,
        r#""a": (type: "image.constant", size: (4, 3), color: (0.25, 0.25, 0.25, 1.0)), "e": (type: "paper.exposure", image: "@a"),
        "m": (type: "meter.range", exposure: "@e.exposure"), "out": (type: "io.write_value", value: "@m", path: "$out/m.npz"),"#,
    );
    let library = shot.path(&library_name("meter"));
    let (graph, out) = (shot.path("g.ron"), shot.path("out"));
    let run = |defines: &[&str]| {
        let _ = std::fs::remove_file(&library);
        compile(&root().join("tests/all/plugins/meter.c"), "plugins/include", defines, &library);
        let manifest = match defines {
            [] => write_manifest(&library),
            // One process loads no two libraries from one place; the manifest alone says enough.
            _ => {
                let path = shot.path("meter.plugin.ron");
                let text = std::fs::read_to_string(&path).unwrap();
                std::fs::write(&path, text.replace("dtype: f64", "dtype: f32")).unwrap();
                path
            }
        };
        let plugins = [examples().to_str().unwrap(), manifest.to_str().unwrap()];
        cli(&[
            "run",
            graph.to_str().unwrap(),
            "--out",
            out.to_str().unwrap(),
            "--no-cache",
            "--plugins",
            plugins[0],
            "--plugins",
            plugins[1],
        ])
    };
    let ran = run(&[]);
    assert_eq!(ran.code, 0, "{}", ran.err);
    let registry = crate::support::plugins::registry();
    let file = std::fs::File::open(out.join("m.npz")).unwrap();
    let read = pegbar_engine::npz::Archive::open(file, 1 << 20).unwrap().parts().unwrap();
    let value = (registry.get_type("Vector").unwrap().from_parts)(read).unwrap();
    assert_eq!(value.parts().arrays[0].1.numbers(), [0.25, 0.25]);
    let ran = run(&["NARROW"]);
    let expected = "value type `Exposure`: expected means f64 [t]; gains f64 [t], found means f32 [t]; gains f32 [t]";
    assert!(ran.code == 2 && ran.err.contains(expected), "{}", ran.err);
}
