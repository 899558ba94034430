//! What `pegbar plugin new` and `pegbar new node` write: it builds, and passes every check.

use std::path::Path;
use std::process::Command;

use crate::support::plugins::library_name;
use crate::support::root;
use crate::support::shot::cli;

const PEGBAR: &str = env!("CARGO_BIN_EXE_pegbar");

/// Runs a program in a folder; what it says.
fn run(folder: &Path, program: &str, args: &[&str]) -> String {
    let done = Command::new(program).current_dir(folder).env("PEGBAR", PEGBAR).args(args).output().unwrap();
    let said = format!("{}{}", String::from_utf8_lossy(&done.stdout), String::from_utf8_lossy(&done.stderr));
    assert!(done.status.success(), "{program} {args:?}: {said}");
    said
}

#[test]
fn a_new_plugin_in_c_or_c_plus_plus_builds_and_passes() {
    for language in ["c", "cpp"] {
        let folder = tempfile::tempdir().unwrap();
        let plugin = folder.path().join("bright");
        let ran = cli(&["plugin", "new", plugin.to_str().unwrap(), "--lang", language]);
        assert_eq!(ran.code, 0, "{}", ran.err);
        let said = run(&plugin, "make", &["check", &format!("PEGBAR={PEGBAR}")]);
        assert!(said.contains("16 checks: 16 passed, 0 failed, 0 not tried"), "{said}");
        run(&plugin, PEGBAR, &["run", "bright.ron", "--no-cache"]);
        assert!(plugin.join("out/bright.0002.png").exists());
        let readme = std::fs::read_to_string(plugin.join("README.md")).unwrap();
        assert!(!readme.contains('{') && readme.contains("bright.gain"), "{readme}");

        // Nothing is written over, and nothing beside what is there.
        std::fs::remove_file(plugin.join("README.md")).unwrap();
        let ran = cli(&["plugin", "new", plugin.to_str().unwrap(), "--lang", language]);
        assert!(ran.code == 2 && ran.err.contains("found a file: nothing was written"), "{}", ran.err);
        assert!(!plugin.join("README.md").exists());
    }
}

#[test]
fn new_nodes_in_rust_build_and_pass() {
    let folder = tempfile::tempdir().unwrap();
    let plugin = folder.path().join("grain");
    let new = |id: &str| cli(&["new", "node", folder.path().join(id).to_str().unwrap(), "--sdk", root().to_str().unwrap()]);
    assert_eq!(new("grain.soft").code, 0);
    // The second goes beside the first, and says what is left to do.
    let ran = new("grain.very_rough");
    assert_eq!(ran.code, 0, "{}", ran.err);
    assert!(ran.err.contains("`mod very_rough;`") && ran.err.contains("`very_rough::VeryRough`"), "{}", ran.err);
    let lib = std::fs::read_to_string(plugin.join("src/lib.rs")).unwrap();
    let lib = lib.replace("mod soft;", "mod soft;\nmod very_rough;").replace("soft::Soft]", "soft::Soft, very_rough::VeryRough]");
    std::fs::write(plugin.join("src/lib.rs"), lib).unwrap();
    assert!(std::fs::read_to_string(plugin.join("src/soft.rs")).unwrap().lines().count() <= 25);
    assert_eq!(new("grain.soft").code, 2);

    // The versions of this build, as no others need be here.
    std::fs::copy(root().join("Cargo.lock"), plugin.join("Cargo.lock")).unwrap();
    let target = Path::new(env!("CARGO_TARGET_TMPDIR")).join("scaffold");
    run(&plugin, env!("CARGO"), &["build", "--offline", "--quiet", "--target-dir", target.to_str().unwrap()]);
    let library = plugin.join("target/release").join(library_name("grain"));
    std::fs::create_dir_all(library.parent().unwrap()).unwrap();
    std::fs::copy(target.join("debug").join(library_name("grain")), &library).unwrap();
    run(&plugin, PEGBAR, &["plugin", "manifest", library.to_str().unwrap()]);
    let said = run(&plugin, PEGBAR, &["plugin", "check", library.to_str().unwrap()]);
    assert!(said.contains("29 checks: 29 passed, 0 failed, 0 not tried"), "{said}");
    run(&plugin, PEGBAR, &["run", "grain.ron", "--no-cache"]);
    assert!(plugin.join("out/grain.0001.png").exists());
}

#[test]
fn names_that_are_none_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    for (args, expected) in [
        (["plugin", "new", "Grain"], "expected a lower case word that means nothing in Rust, as `grain`, found `Grain`"),
        (["new", "node", "grain"], "expected a node's id as plugin.word, found `grain`"),
        (["new", "node", "grain.move"], "found `move`"),
        (["new", "node", "grain.a.b"], "found `a.b`"),
    ] {
        let path = folder.path().join(args[2]);
        let ran = cli(&[args[0], args[1], path.to_str().unwrap()]);
        assert!(ran.code == 2 && ran.err.contains(expected) && ran.err.contains("nothing was written"), "{args:?}: {}", ran.err);
    }
    let ran = cli(&["plugin", "new", folder.path().join("grain").to_str().unwrap(), "--sdk", "/nowhere"]);
    assert!(ran.code == 2 && ran.err.contains("expected Pegbar's source at /nowhere"), "{}", ran.err);
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0);
}
