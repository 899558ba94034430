//! Failure bundles: what failed in a run fails alone, elsewhere, in the same words.

use std::path::{Path, PathBuf};
use std::sync::Mutex;

use proptest::prelude::*;

use crate::bundle::{Bundle, BundleError, Replayed, folder_name, save};
use crate::check::{LoadOptions, load};
use crate::exec::{Failure, Observer, Options, execute};
use crate::graph::Graph;
use crate::node::{Cancel, Computed, Context, Frames, In, List, NodeError, OutValue, PerFrame, Recurrent, Sequence, Stream, Whole};
use crate::plan::Target;
use crate::registry::Registry;
use crate::setting::{InputPath, Missing, OutputPath};
use crate::value::{Curve, Vector, downcast};
use crate::{Node, Outputs};

/// One number.
#[derive(Outputs)]
struct Number {
    /// It.
    value: Curve,
}

/// Fails where what it is given says so.
fn judge(sum: f64, limit: f64, panics: bool) -> Result<Number, NodeError> {
    assert!(!(panics && sum > limit), "{sum:?} fell over {limit:?}");
    match sum > limit {
        true => Err(NodeError::input(format!("expected at most {limit:?}, found {sum:?}")).help("ask for less")),
        false => Ok(Number { value: Curve { value: sum } }),
    }
}

/// Looks at inputs of all kinds.
#[derive(Node)]
#[node(id = "test.judge", version = 2, outputs = Number)]
struct Judge {
    /// One.
    a: In<Curve>,
    /// Left out or not.
    b: Option<In<Curve>>,
    /// Several.
    list: List<In<Curve>>,
    /// Frames around.
    window: Frames<Curve>,
    /// A setting, or a wire.
    #[input(default = 1.0)]
    gain: f64,
    /// Text.
    #[input(default = "a \"quoted\" text")]
    note: String,
    /// The most.
    limit: f64,
    /// True for a panic.
    #[input(default = false)]
    panics: bool,
}

impl PerFrame for Judge {
    fn reads(&self, _input: &str, cx: &Context) -> Vec<i64> {
        [-1, 0, 1].map(|d| cx.clock.clamp(cx.frame + d)).to_vec()
    }
    fn run(self, cx: &Context) -> Result<Number, NodeError> {
        let window = self.reads("", cx).into_iter().map(|f| Ok(self.window.at(f)?.value)).sum::<Result<f64, NodeError>>()?;
        let list: f64 = self.list.0.iter().map(|v| v.value).sum();
        let of_note = self.note.len() as f64 / 1024.0;
        judge((self.a.value + self.b.map_or(0.5, |b| b.value) + list + window) * self.gain + of_note, self.limit, self.panics)
    }
}

/// A sum that fails once it is too large.
#[derive(Node)]
#[node(id = "test.pile", version = 1, kind = recurrent, outputs = Number)]
struct Pile {
    /// What is added.
    a: In<Curve>,
    /// The most.
    limit: f64,
}

impl Recurrent for Pile {
    type State = Vector;
    fn run(self, state: Option<&Vector>, _cx: &Context) -> Result<(Number, Vector), NodeError> {
        let mut values = state.map_or_else(Vec::new, |s| s.values.clone());
        values.push(self.a.value);
        Ok((judge(values.iter().sum(), self.limit, false)?, Vector { values }))
    }
}

/// The sum of a sequence.
#[derive(Node)]
#[node(id = "test.whole", version = 1, kind = whole, outputs = Number)]
struct All {
    /// The sequence.
    a: Sequence<Vector>,
    /// The most.
    limit: f64,
}

impl Whole for All {
    fn run(self, cx: &Context) -> Result<Number, NodeError> {
        let sum = (0..self.a.len()).map(|i| Ok(self.a.get(i)?.values.iter().sum::<f64>())).sum::<Result<f64, NodeError>>()?;
        let first = self.a.clock().map_or(0, |c| c.first) as f64;
        judge(sum + first + cx.clock.last as f64 + cx.input_clock("a").rate(), self.limit, false)
    }
}

/// A stream.
#[derive(Outputs)]
struct Numbered {
    /// A number a frame.
    value: Stream<Curve>,
}

/// Gives fewer frames than there are.
#[derive(Node)]
#[node(id = "test.short", version = 1, kind = whole, outputs = Numbered)]
struct Short {
    /// Left alone.
    #[allow(dead_code, reason = "it gives what it gives")]
    a: Sequence<Curve>,
}

impl Whole for Short {
    fn run(self, _cx: &Context) -> Result<Numbered, NodeError> {
        Ok(Numbered { value: Stream(vec![Curve { value: 0.0 }]) })
    }
}

/// Several numbers.
#[derive(Outputs)]
struct Numbers {
    /// They.
    values: Vector,
}

/// A value of another size at each frame.
#[derive(Node)]
#[node(id = "test.ragged", version = 1, outputs = Numbers)]
struct Ragged {
    /// How many.
    a: In<Curve>,
}

impl PerFrame for Ragged {
    fn run(self, _cx: &Context) -> Result<Numbers, NodeError> {
        Ok(Numbers { values: Vector { values: vec![0.5; self.a.value.abs() as usize] } })
    }
}

/// The file that a file refers to, where it does.
fn referred(path: &Path) -> Vec<PathBuf> {
    let text = std::fs::read_to_string(path).unwrap_or_default();
    text.strip_prefix("see ").map(|name| path.with_file_name(name)).into_iter().collect()
}

/// A number in a file, or in the one that it refers to.
#[derive(Node)]
#[node(id = "test.read", version = 1, kind = source, outputs = Number, beside = referred)]
struct Read {
    /// The file.
    path: InputPath,
    /// Where there is none.
    #[input(default = error)]
    missing: Missing,
}

impl PerFrame for Read {
    fn run(self, cx: &Context) -> Result<Number, NodeError> {
        let path = self.path.resolve(cx.frame, self.missing).ok_or_else(|| NodeError::input(self.path.pattern()))?;
        let path = referred(&path).pop().unwrap_or(path);
        let text = std::fs::read_to_string(&path).map_err(|e| NodeError::io(&path, e))?;
        let value = text.trim().parse().map_err(|e| NodeError::io(&path, e).help(format!("look into {}", path.display())))?;
        Ok(Number { value: Curve { value } })
    }
}

/// A number into a file, but for large ones.
#[derive(Node)]
#[node(id = "test.write", version = 1, kind = sink)]
struct Write {
    /// The number.
    a: In<Curve>,
    /// The file.
    path: OutputPath,
}

impl PerFrame for Write {
    fn run(self, cx: &Context) -> Result<(), NodeError> {
        let path = self.path.at(cx.frame);
        std::fs::write(&path, "begun").map_err(|e| NodeError::io(&path, e))?;
        if self.a.value > 2.0 { Err(NodeError::io(&path, "expected a small number, found a large one")) } else { Ok(()) }
    }
}

fn registry() -> Registry {
    super::nodes::registry()
        .per_frame::<Judge>()
        .recurrent::<Pile>()
        .whole::<All>()
        .whole::<Short>()
        .per_frame::<Ragged>()
        .per_frame::<Read>()
        .per_frame::<Write>()
}

fn graph_in(folder: &Path, nodes: &str) -> Graph {
    let path = folder.join("main.ron");
    std::fs::write(&path, format!("Graph(pegbar: 1, frames: (first: -2, last: 4, fps: 24), nodes: {{ {nodes} }})")).unwrap();
    let loaded = load(&path, &registry(), &LoadOptions { out: folder.join("out"), ..LoadOptions::default() });
    assert!(loaded.graph.is_some(), "{}", loaded.sources.render_all(&loaded.diagnostics, false));
    loaded.graph.unwrap()
}

/// Saves every failure.
struct Saver<'a>(&'a Path, Mutex<Vec<(Failure, PathBuf)>>);

impl Observer for Saver<'_> {
    fn failed(&self, graph: &Graph, failure: &Failure) {
        let folder = save(graph, failure, self.0).unwrap();
        self.1.lock().unwrap().push((failure.clone(), folder));
    }
    fn keeps_inputs(&self) -> bool {
        true
    }
}

/// Runs all of a graph; its failures with their bundles.
fn failures(graph: &Graph, bundles: &Path) -> Vec<(Failure, PathBuf)> {
    let saver = Saver(bundles, Mutex::default());
    let targets: Vec<Target> = (0..graph.nodes.len()).map(|node| Target { node, frames: None }).collect();
    execute(graph, &targets, &[], &Options { threads: 2, observer: &saver, ..Options::default() }).unwrap();
    saver.1.into_inner().unwrap()
}

fn replay(bundle: &Path) -> Result<Replayed, BundleError> {
    Bundle::open(bundle, &registry())?.replay(None, &Cancel::default())
}

/// Nothing where the failure is met again.
fn difference(failure: &Failure, bundle: &Path) -> Option<String> {
    let saved = Bundle::open(bundle, &registry()).unwrap();
    assert_eq!((saved.error(), saved.frame(), saved.shapes()), (&failure.error, failure.frame, failure.inputs.as_slice()));
    match replay(bundle).unwrap() {
        Replayed::Same => None,
        Replayed::Other(error) => Some(format!("expected {:?}, found {error:?}", failure.error)),
        Replayed::Fine(_) => Some(format!("expected {:?}, found no failure", failure.error)),
    }
}

fn files(folder: &Path) -> Vec<String> {
    let entries = std::fs::read_dir(folder).unwrap().map(|e| e.unwrap());
    let mut names: Vec<String> = entries
        .flat_map(|e| match e.path().is_dir() {
            true => files(&e.path()).into_iter().map(|n| format!("{}/{n}", e.file_name().to_string_lossy())).collect(),
            false => vec![e.file_name().to_string_lossy().into_owned()],
        })
        .collect();
    names.sort();
    names
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(40))]
    #[test]
    fn what_failed_in_a_run_fails_alone_in_the_same_words(
        kinds in proptest::collection::vec((0..4u8, any::<proptest::sample::Index>(), any::<proptest::sample::Index>()), 1..6),
        ends in proptest::collection::vec(any::<proptest::sample::Index>(), 4),
        limit in -8..20i32,
        gain in -3..4i32,
        panics in any::<bool>(),
    ) {
        let mut nodes = "\"n0\": (type: \"test.frame\"), ".to_owned();
        for (i, (kind, a, b)) in kinds.iter().enumerate() {
            let (a, b) = (a.index(i + 1), b.index(i + 1));
            nodes += &match kind {
                0 => format!("\"n{}\": (type: \"test.add\", a: \"@n{a}\", b: \"@n{b}\"), ", i + 1),
                1 => format!("\"n{}\": (type: \"test.window\", stream: \"@n{a}\"), ", i + 1),
                2 => format!("\"n{}\": (type: \"test.total\", stream: \"@n{a}\"), ", i + 1),
                _ => format!("\"n{}\": (type: \"test.add\", a: {i}.5, b: \"@n{b}\"), ", i + 1),
            };
        }
        let [a, b, c, d] = [0, 1, 2, 3].map(|i: usize| ends[i].index(kinds.len() + 1));
        let limit = f64::from(limit) / 2.0;
        let b = if limit > 3.0 { format!("b: \"@n{b}\", ") } else { String::new() };
        let gain = if gain == 0 { format!("\"@n{d}\"") } else { format!("{gain}.25") };
        nodes += &format!(
            "\"j\": (type: \"test.judge\", a: \"@n{a}\", {b}list: [\"@n{c}\", \"@n{d}\"], window: \"@n{c}\", gain: {gain}, limit: {limit:?}, panics: {panics}),
             \"p\": (type: \"test.pile\", a: \"@n{c}\", limit: {limit:?}),
             \"r\": (type: \"test.ragged\", a: \"@n{d}\"),
             \"w\": (type: \"test.whole\", a: \"@r\", limit: {limit:?})"
        );
        let folder = tempfile::tempdir().unwrap();
        let graph = graph_in(folder.path(), &nodes);
        let bundles = folder.path().join("bundles");
        for (failure, bundle) in failures(&graph, &bundles) {
            prop_assert_eq!(difference(&failure, &bundle), None, "{}", nodes);
            prop_assert!(bundle.ends_with(folder_name(&graph.nodes[failure.node].name, failure.frame)));
        }
    }
}

const FAILING: &str = r#""f": (type: "test.frame"), "r": (type: "test.ragged", a: "@f"),
    "j": (type: "test.judge", a: "@f", list: ["@f", "@f"], window: "@f", limit: 16.0),
    "p": (type: "test.pile", a: "@f", limit: 6.0), "w": (type: "test.whole", a: "@r", limit: 0.0)"#;

#[test]
fn a_bundle_holds_what_the_task_was_given_and_nothing_else() {
    let folder = tempfile::tempdir().unwrap();
    let bundles = folder.path().join("bundles");
    let found = failures(&graph_in(folder.path(), FAILING), &bundles);
    assert!(found.iter().all(|(f, bundle)| difference(f, bundle).is_none()));
    let mut names: Vec<String> =
        std::fs::read_dir(&bundles).unwrap().map(|e| e.unwrap().file_name().to_string_lossy().into_owned()).collect();
    names.sort();
    assert_eq!(names, ["j@3", "j@4", "p@4", "w"]);
    let of_judge = [
        "failure.json",
        "inputs/a.npz",
        "inputs/list.0.npz",
        "inputs/list.1.npz",
        "inputs/window@2.npz",
        "inputs/window@3.npz",
        "inputs/window@4.npz",
    ];
    assert_eq!(files(&bundles.join("j@3")), of_judge);
    assert_eq!(files(&bundles.join("p@4")), ["failure.json", "inputs/a.npz", "state.npz"]);
    let of_whole: Vec<String> = (-2..=4).map(|f| format!("inputs/a@{f}.npz")).collect();
    assert!(of_whole.iter().all(|f| files(&bundles.join("w")).contains(f)), "{:?}", files(&bundles.join("w")));
    let text = std::fs::read_to_string(bundles.join("j@3/failure.json")).unwrap();
    assert!(!text.contains(&*folder.path().to_string_lossy()), "{text}");
}

#[test]
fn a_newer_failure_takes_the_place_of_an_older_one_and_of_nothing_else() {
    let folder = tempfile::tempdir().unwrap();
    let bundles = folder.path().join("bundles");
    failures(&graph_in(folder.path(), FAILING), &bundles);
    let (failure, bundle) = failures(&graph_in(folder.path(), &FAILING.replace("16.0", "17.5")), &bundles)
        .into_iter()
        .find(|(f, _)| f.frame == Some(4))
        .unwrap();
    assert_eq!(difference(&failure, &bundle), None);
    assert_eq!(std::fs::read_dir(&bundles).unwrap().count(), 4, "nothing is left beside the bundles");
    std::fs::remove_file(bundles.join("p@4/failure.json")).unwrap();
    let graph = graph_in(folder.path(), FAILING);
    let given = Some(crate::exec::Given { args: Vec::new(), state: None });
    let failure = Failure { node: graph.find("p").unwrap(), frame: Some(4), error: NodeError::input("x"), inputs: Vec::new(), given };
    let error = save(&graph, &failure, &bundles).unwrap_err().to_string();
    assert!(error.starts_with("expected an older bundle or nothing at"), "{error}");
    assert_eq!(std::fs::read_dir(&bundles).unwrap().count(), 4);
    let error = save(&graph, &Failure { given: None, ..failure }, &bundles).unwrap_err().to_string();
    assert_eq!(error, "expected what node `p` was given, found that the run did not keep it");
}

#[test]
fn names_of_nodes_are_names_of_folders() {
    assert_eq!(folder_name("a/b", Some(-3)), "a.b@-3");
    assert_eq!(folder_name("hat", None), "hat");
    assert_eq!(folder_name("ä:*?\"<>|\\", Some(1)), "ä%3A%2A%3F%22%3C%3E%7C%5C@1");
}

#[test]
fn files_that_are_read_travel_with_the_bundle_and_are_called_as_in_the_run() {
    let home = tempfile::tempdir().unwrap();
    let folder = home.path().join("shot #1");
    std::fs::create_dir_all(folder.join("in")).unwrap();
    (-2..=1).for_each(|f| {
        std::fs::write(folder.join(format!("in/n.{}.txt", if f < 0 { format!("-{:02}", -f) } else { format!("{f:02}") })), "many").unwrap()
    });
    let graph = graph_in(
        &folder,
        r#""seq": (type: "test.read", path: "in/n.##.txt", missing: hold), "one": (type: "test.read", path: "in/n.00.txt")"#,
    );
    let found = failures(&graph, &folder.join("bundles"));
    assert_eq!(found.len(), 8, "seven frames of one, and the other once");
    let moved = home.path().join("moved");
    std::fs::rename(folder.join("bundles"), &moved).unwrap();
    std::fs::remove_dir_all(&folder).unwrap();
    for (failure, bundle) in &found {
        assert!(failure.error.message.contains("shot #1/in/n."), "{}", failure.error);
        let bundle = moved.join(bundle.file_name().unwrap());
        assert_eq!(difference(failure, &bundle), None);
    }
    assert_eq!(files(&moved.join("seq@4")), ["failure.json", "files/path/n.01.txt"]);
}

#[test]
fn files_that_a_file_names_travel_with_it_but_none_from_outside_its_folder() {
    let folder = tempfile::tempdir().unwrap();
    let write = |name: &str, text: &str| std::fs::write(folder.path().join(name), text).unwrap();
    std::fs::create_dir_all(folder.path().join("in/data")).unwrap();
    write("in/a.txt", "see data/a.bin");
    write("in/data/a.bin", "many");
    write("in/b.txt", "see ../b.bin");
    write("b.bin", "many");
    let graph = graph_in(folder.path(), r#""a": (type: "test.read", path: "in/a.txt"), "b": (type: "test.read", path: "in/b.txt")"#);
    let mut found = failures(&graph, &folder.path().join("bundles"));
    found.sort_by_key(|(f, _)| f.node);
    assert_eq!(difference(&found[0].0, &found[0].1), None);
    assert_eq!(files(&found[0].1), ["failure.json", "files/path/a.txt", "files/path/data/a.bin"]);
    assert_eq!(files(&found[1].1), ["failure.json", "files/path/b.txt"]);
}

#[test]
fn what_the_executor_refuses_is_refused_again() {
    let folder = tempfile::tempdir().unwrap();
    let graph = graph_in(folder.path(), r#""f": (type: "test.frame"), "s": (type: "test.short", a: "@f")"#);
    let found = failures(&graph, &folder.path().join("bundles"));
    assert_eq!(found[0].0.error.message, "expected 7 frames of `value`, found 1");
    assert_eq!(difference(&found[0].0, &found[0].1), None);
}

#[test]
fn a_file_that_is_missed_is_missed_again() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("n.txt"), "1").unwrap();
    let graph = graph_in(folder.path(), r#""one": (type: "test.read", path: "n.txt")"#);
    std::fs::remove_file(folder.path().join("n.txt")).unwrap();
    let found = failures(&graph, &folder.path().join("bundles"));
    assert_eq!(found.len(), 1);
    assert_eq!(difference(&found[0].0, &found[0].1), None);
}

#[test]
fn what_a_replay_writes_lies_below_its_own_folder() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::create_dir_all(folder.path().join("out")).unwrap();
    let graph = graph_in(folder.path(), r#""f": (type: "test.frame"), "o": (type: "test.write", a: "@f", path: "n.##.txt")"#);
    let found = failures(&graph, &folder.path().join("bundles"));
    assert_eq!(found.len(), 2);
    std::fs::remove_dir_all(folder.path().join("out")).unwrap();
    assert!(found.iter().all(|(f, bundle)| difference(f, bundle).is_none()));
    assert!(!folder.path().join("out").exists());
    let out = tempfile::tempdir().unwrap();
    Bundle::open(&found[0].1, &registry()).unwrap().replay(Some(out.path()), &Cancel::default()).unwrap();
    assert_eq!(files(out.path()).len(), 1);
}

/// The outputs of a replay that does not fail.
fn computed(bundle: &Path) -> Computed {
    match replay(bundle).unwrap() {
        Replayed::Fine(computed) => computed,
        _ => panic!("expected no failure"),
    }
}

#[test]
fn a_failure_that_is_mended_is_told() {
    let folder = tempfile::tempdir().unwrap();
    let bundles = folder.path().join("bundles");
    failures(&graph_in(folder.path(), FAILING), &bundles);
    let record = bundles.join("p@4/failure.json");
    let text = std::fs::read_to_string(&record).unwrap();
    std::fs::write(&record, text.replace("\"6.0\"", "\"7.0\"")).unwrap();
    let computed = computed(&bundles.join("p@4"));
    let OutValue::One(value) = &computed.outputs[0] else { panic!("expected one value") };
    assert_eq!(downcast::<Curve>(value.clone()).unwrap().value, 7.0);
    let out = folder.path().join("values");
    let written = Bundle::open(&bundles.join("p@4"), &registry()).unwrap().write_outputs(&computed, &out).unwrap();
    assert_eq!(written, [out.join("value.npz")]);
    std::fs::write(&record, text.replace("\"6.0\"", "\"5.0\"")).unwrap();
    let Replayed::Other(error) = replay(&bundles.join("p@4")).unwrap() else { panic!("expected another failure") };
    assert_eq!(error.message, "expected at most 5.0, found 7.0");
}

#[test]
fn a_bundle_that_is_not_whole_or_not_of_this_pegbar_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let bundles = folder.path().join("bundles");
    failures(&graph_in(folder.path(), FAILING), &bundles);
    let bundle = bundles.join("p@4");
    let record = std::fs::read_to_string(bundle.join("failure.json")).unwrap();
    let refusal =
        |registry: &Registry| Bundle::open(&bundle, registry).err().map(|e| e.to_string().replace(&format!("{}/", bundles.display()), ""));
    let with = |text: String| {
        std::fs::write(bundle.join("failure.json"), text).unwrap();
        Bundle::open(&bundle, &registry())
            .and_then(|b| b.replay(None, &Cancel::default()))
            .err()
            .map(|e| e.to_string().replace(&format!("{}/", bundles.display()), ""))
    };
    let version = env!("CARGO_PKG_VERSION");
    let unknown = format!(
        "expected a node type of this Pegbar, found `test.pile`, saved by Pegbar {version}; replay the bundle with the plugins of the run"
    );
    assert_eq!(refusal(&super::nodes::registry()), Some(unknown));
    let other =
        format!("expected version 7 of `test.pile`, as saved by Pegbar {version}, found version 1; replay the bundle with that Pegbar");
    assert_eq!(with(record.replace("\"version\": 1", "\"version\": 7")), Some(other));
    let cases = [
        (
            record.replace("\"format\": 1", "\"format\": 9"),
            "expected a failure bundle at p@4, found one of format 9 where this Pegbar reads format 1",
        ),
        (
            record[..40].to_owned(),
            "expected a failure bundle at p@4, found a failure.json that cannot be read: EOF while parsing a string at line 4 column 7",
        ),
        ("{}".to_owned(), "expected a failure bundle at p@4, found a failure.json without a format"),
        (record.replace("inputs/a.npz", "../a.npz"), "expected a failure bundle at p@4, found `../a.npz`, a file outside of it"),
        (record.replace("\"name\": \"limit\"", "\"name\": \"limits\""), "input `limit`: expected it in failure.json, found none"),
        (record.replace("\"Curve\"", "\"Bend\""), "expected a failure bundle at p@4, found inputs/a.npz of the unknown value type `Bend`"),
    ];
    for (text, expected) in cases {
        let found = with(text).unwrap_or_default();
        let same = found == expected || (expected.contains("EOF") && found.contains("cannot be read: EOF"));
        assert!(same, "expected {expected}\nfound    {found}");
    }
    assert_eq!(with(record), None);
    std::fs::write(bundle.join("state.npz"), "another").unwrap();
    assert_eq!(
        refusal(&registry()).as_deref(),
        Some("expected p@4/state.npz as it was saved, found other contents; copy the bundle again")
    );
    std::fs::remove_file(bundle.join("state.npz")).unwrap();
    assert_eq!(refusal(&registry()).as_deref(), Some("expected p@4/state.npz as it was saved, found none; copy the bundle again"));
    assert!(matches!(Bundle::open(folder.path(), &registry()), Err(BundleError::Record { .. })));
}
