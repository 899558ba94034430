//! Plugins as the tests have them: built, with their manifests beside them, in a folder of this target.

use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::OnceLock;

use pegbar_engine::plugin::{ENDING, LibraryFile, Manifest, describe, digest, found_in, platform};
use pegbar_engine::registry::Registry;

use super::root;

/// `libNAME.so`, or what this system calls it.
pub(crate) fn library_name(name: &str) -> String {
    format!("{}{name}{}", std::env::consts::DLL_PREFIX, std::env::consts::DLL_SUFFIX)
}

/// Compiles a plugin in C, or in C++ by the ending of its name; Rust links with the compiler that this takes.
pub(crate) fn compile(source: &Path, include: &str, defines: &[&str], library: &Path) {
    let is_cpp = source.extension().is_some_and(|e| e == "cpp");
    let (variable, usual) = if is_cpp { ("CXX", "c++") } else { ("CC", "cc") };
    let compiler = std::env::var_os(variable).unwrap_or_else(|| usual.into());
    compile_by(Path::new(&compiler), &["-O2"], source, include, defines, library);
}

/// Compiles a plugin with a compiler and flags of its own.
pub(crate) fn compile_by(compiler: &Path, flags: &[&str], source: &Path, include: &str, defines: &[&str], library: &Path) {
    // Built beside its place, as others may be loading what is there.
    let temporary = tempfile::NamedTempFile::new_in(library.parent().unwrap()).unwrap();
    let standard = if source.extension().is_some_and(|e| e == "cpp") { "-std=c++17" } else { "-std=c11" };
    let mut cc = Command::new(compiler);
    cc.args(flags).args([standard, "-Wall", "-Wextra", "-Werror", "-shared", "-fPIC", "-ffp-contract=off", "-I"]);
    cc.arg(root().join(include)).args(defines.iter().map(|d| format!("-D{d}"))).arg("-o").arg(temporary.path());
    let done = cc.arg(source).arg("-lm").output().expect("a C compiler");
    assert!(done.status.success(), "{}", String::from_utf8_lossy(&done.stderr));
    temporary.persist(library).unwrap();
}

/// Writes the manifest that a library says.
pub(crate) fn write_manifest(library: &Path) -> PathBuf {
    let plugin = describe(library).unwrap();
    let path = library.with_file_name(format!("{}{ENDING}", plugin.name));
    let file = library.file_name().unwrap().to_string_lossy().into_owned();
    let libraries = [(platform(), LibraryFile { file, digest: digest(library).unwrap() })].into();
    Manifest { libraries, plugin }.write(&path).unwrap();
    path
}

/// A folder with the example plugins.
pub(crate) fn examples() -> &'static Path {
    static FOLDER: OnceLock<PathBuf> = OnceLock::new();
    FOLDER.get_or_init(|| {
        let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join(format!("plugins-{}", std::process::id()));
        std::fs::create_dir_all(&folder).unwrap();
        // Cargo puts it beside this test, of which it is a dependency.
        let paper = std::env::current_exe().unwrap().with_file_name(library_name("paper"));
        let copy = folder.join(library_name("paper"));
        std::fs::copy(paper, &copy).unwrap();
        let print = folder.join(library_name("print"));
        compile(&root().join("plugins/examples/c/halftone.c"), "plugins/include", &[], &print);
        [copy, print].iter().for_each(|library| drop(write_manifest(library)));
        folder
    })
}

/// Every built-in node type and those of the example plugins.
pub(crate) fn registry() -> Registry {
    let mut registry = pegbar_nodes::registry();
    let (found, wrong) = found_in(&[examples().to_owned()]);
    assert!(wrong.is_empty() && found.len() == 2, "{wrong:?}");
    found.iter().for_each(|found| found.register(&mut registry).unwrap());
    registry
}
