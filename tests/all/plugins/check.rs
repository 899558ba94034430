//! `pegbar plugin check`: what is well passes, and what is not fails on the line that says so.

use std::path::Path;
use std::process::Command;

use pegbar_engine::plugin::conform::{CHECKS, Finding, Outcome};

use crate::support::plugins::{compile, examples, library_name, write_manifest};
use crate::support::root;

/// The exit code and the findings. Runs the program, which starts itself.
fn check(path: &Path, more: &[&str]) -> (i32, Vec<Finding>) {
    let mut command = Command::new(env!("CARGO_BIN_EXE_pegbar"));
    let ran = command.args(["plugin", "check", "--format", "json"]).arg(path).args(more).output().unwrap();
    let text = String::from_utf8(ran.stdout).unwrap();
    let json: serde_json::Value =
        serde_json::from_str(&text).unwrap_or_else(|e| panic!("{e}: {text}{}", String::from_utf8_lossy(&ran.stderr)));
    (ran.status.code().unwrap(), serde_json::from_value(json["findings"].clone()).unwrap())
}

fn failed(findings: &[Finding]) -> Vec<String> {
    let failed = findings.iter().filter(|f| f.outcome != Outcome::Passed);
    failed.map(|f| format!("{} {}: {}", f.node.as_deref().unwrap_or("plugin"), f.check, f.found)).collect()
}

#[test]
fn the_example_plugins_pass_every_check() {
    for (name, nodes) in [("paper", 5), ("print", 1)] {
        let (code, findings) = check(&examples().join(library_name(name)), &[]);
        assert_eq!((code, failed(&findings)), (0, Vec::new()), "{name}");
        assert_eq!(findings.len(), 3 + nodes * (2 + CHECKS.len()), "{name}");
    }
    let (code, findings) = check(&examples().join("print.plugin.ron"), &[]);
    assert_eq!((code, failed(&findings)), (0, Vec::new()));
}

/// The faulty plugin with one fault, and its manifest.
fn faulty(folder: &Path, fault: &str) -> std::path::PathBuf {
    let library = folder.join(library_name("faulty"));
    let defines: Vec<&str> = if fault.is_empty() { Vec::new() } else { vec![fault] };
    compile(&root().join("tests/all/plugins/faulty.c"), "plugins/include", &defines, &library);
    library
}

#[test]
fn each_fault_fails_on_its_line() {
    let crash = "expected an answer, found a crash: signal 11 (memory that it may not touch)";
    // Some faults are seen by several checks; the first is the one that names it.
    let cases: &[(&str, &str, &str)] = &[
        ("", "", ""),
        ("PRINTS", "", ""),
        ("NULL_AT_ONE", "sizes", &format!("values of 1x1x4, 1 points, frame 1: {crash}")),
        ("OVERREAD", "sizes", &format!("values of 1x1x4, 1 points, read-only, nothing behind them, frame 1: {crash}")),
        ("FORGETS_EMPTY", "sizes", "values of 0x0x4, 0 points, frame 1: plugin `faulty` 1.0.0: output `image`: expected Image, found none"),
        ("HOLDS", "leaks", "expected the values that it was given to be let go of, found 64 of 64 kept"),
        ("LEAKS", "leaks", "a task with ordinary values: expected memory to be given back, found "),
        ("LEAKS_BLOCK", "leaks", "a task with ordinary values: expected memory to be given back, found "),
        ("LEAKS_INSTANCE", "leaks", "a new instance: expected memory to be given back, found "),
        ("COUNTS", "same", "frame 4 again, backwards: expected the same bits, found others in `image`"),
        ("READS_FRAME", "same", "the same input at two frames: expected the same bits, found others in `image`"),
        ("OF_ONE_THREAD", "threads", "8 threads at once, frame "),
        ("ENDS_AT_NAN", "values", "NaN everywhere at `image`, frame 1: expected an answer, found the process ended (exit status: 0)"),
        (
            "GOES_ON",
            "cancel",
            "a task of 1280x720, 20000 points, that is to stop: expected it to stop within a second, found that it went on for",
        ),
        ("BEYOND", "ordinary", "at frame 4: expected frames 1 to 4 of `image` to be asked for, found 5"),
        ("DOC=\"No sentence\"", "docs", "the node: expected a sentence with a full stop, found \"No sentence\""),
        ("DEFAULT=\"1.5\"", "schema", "input `gain`: expected a default from 0 to 1, found 1.5"),
    ];
    for (fault, line, found) in cases {
        let folder = tempfile::tempdir().unwrap();
        let library = faulty(folder.path(), fault);
        write_manifest(&library);
        let (code, findings) = check(&library, &[]);
        let failed = failed(&findings);
        let Some(first) = failed.first() else {
            assert_eq!((code, *line), (0, ""), "{fault}");
            continue;
        };
        assert!(code == 1 && first.starts_with(&format!("faulty.half {line}: {found}")), "{fault}: {failed:#?}");
        // Whatever ends its process, the others are tried.
        assert_eq!(findings.len(), 3 + 2 + CHECKS.len(), "{fault}");
    }
}

#[test]
fn what_touches_its_inputs_fails_on_the_line_of_inputs() {
    for (fault, expected) in [
        ("SCRIBBLE", "frame 1: expected its inputs to stay as they are, found them written to"),
        ("KEEPS_POINTER", "inputs that may only be read, frame 2: expected an answer, found a crash: signal 11"),
    ] {
        let folder = tempfile::tempdir().unwrap();
        let library = faulty(folder.path(), fault);
        write_manifest(&library);
        let (_, findings) = check(&library, &[]);
        let line = findings.iter().find(|f| f.check == "inputs").unwrap();
        assert!(line.outcome == Outcome::Failed && line.found.starts_with(expected), "{fault}: {:#?}", failed(&findings));
    }
}

#[test]
fn what_never_ends_is_ended() {
    let folder = tempfile::tempdir().unwrap();
    let library = faulty(folder.path(), "HANGS_AT_INFINITY");
    write_manifest(&library);
    let (code, findings) = check(&library, &["--timeout", "15"]);
    let failed = failed(&findings);
    let expected = "faulty.half values: infinities at `image`, frame 1: expected an end within 15 s, found none";
    assert_eq!((code, failed), (1, vec![expected.to_owned()]));
}

#[test]
fn a_library_without_its_manifest_or_with_another_fails_on_that_line() {
    let folder = tempfile::tempdir().unwrap();
    let library = faulty(folder.path(), "");
    let (code, findings) = check(&library, &[]);
    assert_eq!(
        (code, failed(&findings)),
        (1, vec!["plugin manifest: expected faulty.plugin.ron beside the library, found none that names it".to_owned()])
    );
    let manifest = write_manifest(&library);
    let text = std::fs::read_to_string(&manifest).unwrap();
    std::fs::write(&manifest, text.replace("The darker picture.", "A darker picture.")).unwrap();
    let (code, findings) = check(&manifest, &[]);
    assert!(
        code == 1 && failed(&findings)[0].contains("nodes `faulty.half`: expected  doc:\\\"The darker")
            || failed(&findings)[0].contains("The darker"),
        "{:?}",
        failed(&findings)
    );
    let folder = tempfile::tempdir().unwrap();
    let (code, findings) = check(&faulty(folder.path(), "DIES_AT_ENTRY"), &[]);
    let expected = "plugin library: while it was loaded: expected an answer, found a crash: signal 6 (abort)";
    assert_eq!((code, failed(&findings)), (1, vec![expected.to_owned()]));
    let ran = Command::new(env!("CARGO_BIN_EXE_pegbar")).args(["plugin", "check", "/nowhere/libnone.so"]).output().unwrap();
    assert_eq!(ran.status.code(), Some(2));
}

#[test]
fn plugins_that_break_their_contract_or_throw_are_told_so() {
    let folder = tempfile::tempdir().unwrap();
    let (odd, thrower) = (folder.path().join(library_name("odd")), folder.path().join(library_name("thrower")));
    compile(&root().join("tests/all/plugins/odd.c"), "plugins/include", &[], &odd);
    compile(&root().join("tests/all/plugins/thrower.cpp"), "plugins/include", &[], &thrower);
    for (library, way, expected) in [
        (&odd, "well", ""),
        (&odd, "missing", "ordinary: ordinary values, frame 1: plugin `odd` 1.0.0: output `vector`: expected Vector, found none"),
        (
            &odd,
            "dtype",
            "ordinary: ordinary values, frame 1: plugin `odd` 1.0.0: output `vector`: array `values`: expected f64 [n], found f32 [6]",
        ),
        (
            &odd,
            "strange status",
            "ordinary: ordinary values, frame 1: plugin `odd` 1.0.0: expected a reason for its failure, found status 77 alone",
        ),
        (
            &odd,
            "fails",
            "ordinary: expected it to take ordinary values, found it to refuse them: expected numbers that add up, found others",
        ),
        (&thrower, "well", ""),
        (&thrower, "exception", "ordinary: ordinary values, frame 1: plugin `thrower` 1.0.0: panicked: thrown by a node"),
    ] {
        let manifest = write_manifest(library);
        let name = manifest.file_name().unwrap().to_string_lossy().replace(".plugin.ron", "");
        let (code, findings) = check(library, &["--set", &format!("{name}.vector.way={way:?}")]);
        let (failed, refuses) = (failed(&findings), way == "fails");
        assert_eq!(code, i32::from(!expected.is_empty() && !refuses), "{way}: {failed:#?}");
        let at = format!("{name}.vector {expected}");
        assert!(expected.is_empty() && failed.is_empty() || failed.first().is_some_and(|f| f.starts_with(&at)), "{way}: {failed:#?}");
    }
}
