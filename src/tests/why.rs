//! `pegbar why`.

use std::path::Path;

use super::{FINE, Ran, Shot, cli, registry};

/// Leaves a record of a run in the folder `cache`.
fn leave_record(shot: &Shot) {
    use pegbar_engine::plan::{Known, Planned, Target, plan};
    let path = shot.path("g.ron");
    let options = pegbar_engine::check::LoadOptions { out: shot.path("out").into(), ..Default::default() };
    let loaded = pegbar_engine::check::load(Path::new(&path), &registry(), &options);
    let graph = loaded.graph.unwrap();
    let targets: Vec<Target> = (0..graph.nodes.len()).map(|node| Target { node, frames: None }).collect();
    let Ok(Planned::Ready(plan)) = plan(&graph, &targets, &[], Known::new()) else { panic!("no plan") };
    let files = pegbar_engine::stamp::Files::new(None);
    let record = pegbar_engine::record::Record::of(&graph, &loaded.sources, Some(&plan), &files).unwrap_or_else(|e| panic!("{}", e.error));
    pegbar_engine::record::Records::of(Path::new(&shot.path("cache")), Path::new(&path)).save(&record).unwrap();
}

/// Asks why, with the dates of runs left out.
fn ask_why(shot: &Shot, args: &[&str]) -> Ran {
    let (graph, out, cache) = (shot.path("g.ron"), shot.path("out"), shot.path("cache"));
    let ran = cli(&[&["why", &graph, "--out", &out, "--cache", &cache], args].concat());
    let dateless = |text: &str| match text.split_once("the run of ") {
        Some((before, after)) => format!("{before}DATE{}", &after[20..]),
        None => text.to_owned(),
    };
    Ran { code: ran.code, out: dateless(&shot.plain(&ran.out)), err: shot.plain(&ran.err) }
}

#[test]
fn why_names_the_first_fact_that_differs() {
    let shot = Shot::new(FINE);
    assert_eq!(ask_why(&shot, &["out"]).out, "out will run: no run of this graph is on record\n");
    leave_record(&shot);
    let ran = ask_why(&shot, &["out@3"]);
    let nothing = "nothing that out@3 is made from has changed since DATE; there the record does not say what came of it\n";
    assert_eq!((ran.code, ran.out.as_str(), ran.err.as_str()), (0, nothing, ""));
    let ran = ask_why(&shot, &["out@3", "--set", "g.gain=3.0"]);
    let expected = "out@3 will run again, for a change since DATE:\n  out reads g: g.gain was 2.0, is 3.0 at command line:1:14\n";
    assert_eq!((ran.code, ran.out.as_str()), (0, expected), "{}", ran.err);
    assert!(ask_why(&shot, &["@f", "--set", "g.gain=3.0"]).out.starts_with("nothing that f is made from"));
    std::fs::write(shot.path("g.ron"), shot.read("g.ron").unwrap().replace("2.0", "4.0")).unwrap();
    let json = ask_why(&shot, &["g", "--format", "json"]);
    let answer: serde_json::Value = serde_json::from_str(&json.out).unwrap();
    assert_eq!((&answer["verdict"], &answer["change"]["was"], &answer["change"]["is"]), (&"changed".into(), &"2.0".into(), &"4.0".into()));
    assert_eq!((&answer["change"]["place"], &answer["change"]["chain"][0]), (&"g.ron:6:49".into(), &"g".into()));
    leave_record(&shot);
    let ran = ask_why(&shot, &["out"]);
    assert!(ran.out.starts_with("nothing has changed since DATE, which ran out again, for a change since that of "), "{}", ran.out);
    assert!(ran.out.ends_with(":\n  out reads g: g.gain was 2.0, is 4.0 at g.ron:6:49\n"), "{}", ran.out);
}

#[test]
fn why_says_what_is_wrong_with_the_question() {
    let shot = Shot::new(FINE);
    let cases = [
        ("ouf", "error: expected a node of the graph, found `ouf`\n  help: did you mean `out`?\n"),
        ("g@9", "error: node `g`: expected frames 1 to 8 of the clock `frames`, asked for frame 9\n"),
        ("g@x", "expected a frame number after `@`, found `x`"),
    ];
    for (node, message) in cases {
        let ran = ask_why(&shot, &[node]);
        assert_eq!((ran.code, ran.out.as_str()), (2, ""), "{node}");
        assert!(ran.err.contains(message), "{}", ran.err);
    }
    assert!(!Path::new(&shot.path("cache")).exists(), "nothing was made");
    leave_record(&shot);
    let folder = std::fs::read_dir(shot.path("cache/v1/runs")).unwrap().next().unwrap().unwrap().path();
    std::fs::write(folder.join("0001.json"), "{").unwrap();
    let ran = ask_why(&shot, &["g"]);
    assert_eq!((ran.code, ran.out.as_str()), (0, "g will run: no run of this graph is on record\n"));
    assert!(ran.err.starts_with("note: cache/v1/runs/") && ran.err.contains("0001.json: expected a record of a run"), "{}", ran.err);
}
