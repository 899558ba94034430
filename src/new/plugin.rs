//! A plugin to begin with: one node, a graph that uses it, and how it is built, in the language that is asked for.

use std::env::consts::{DLL_PREFIX, DLL_SUFFIX};
use std::path::{Path, PathBuf};

use crate::args::Language;
use crate::console::{Console, EXIT_OK, EXIT_WRONG};

const HEADER: &str = include_str!("../../plugins/include/pegbar_plugin.h");
const SKELETON: &str = include_str!("../../plugins/include/pegbar_plugin.hpp");
const NODE: &str = include_str!("plugin/node.rs.txt");
/// What Rust keeps for itself among words that a node might be called.
const KEYWORDS: &str = " as async await box break const continue crate do dyn else enum extern false final fn for gen if impl in let loop macro match mod \
                        move mut override priv pub ref return self static struct super trait true try type typeof unsafe unsized use virtual where while \
                        yield ";

/// A plugin in the folder `path`, whose name is that of the plugin.
pub(crate) fn plugin(path: &Path, language: Language, sdk: Option<&Path>, console: &mut Console) -> u8 {
    scaffold(path, "gain", language, sdk, console)
}

/// The node `PLUGIN.WORD` in Rust: in a plugin of its own, or beside the nodes of the one that is there.
pub(crate) fn node(path: &Path, sdk: Option<&Path>, console: &mut Console) -> u8 {
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    match name.split_once('.') {
        Some((plugin, word)) => scaffold(&path.with_file_name(plugin), word, Language::Rust, sdk, console),
        None => refuse(&format!("expected a node's id as plugin.word, found `{name}`"), console),
    }
}

fn refuse(why: &str, console: &mut Console) -> u8 {
    console.say(&format!("error: {why}: nothing was written\n"));
    EXIT_WRONG
}

fn is_word(text: &str) -> bool {
    text.starts_with(|c: char| c.is_ascii_lowercase()) && text.chars().all(|c| c.is_ascii_lowercase() || c.is_ascii_digit() || c == '_')
}

fn scaffold(folder: &Path, word: &str, language: Language, sdk: Option<&Path>, console: &mut Console) -> u8 {
    let absolute = std::path::absolute(folder).unwrap_or_else(|_| folder.to_owned());
    let name = absolute.file_name().unwrap_or_default().to_string_lossy().into_owned();
    if let Some(strange) = [name.as_str(), word].into_iter().find(|text| !is_word(text) || KEYWORDS.contains(&format!(" {text} "))) {
        return refuse(&format!("expected a lower case word that means nothing in Rust, as `grain`, found `{strange}`"), console);
    }
    let sdk = match sdk.map_or_else(|| Ok(find_sdk(&absolute)), |sdk| given_sdk(sdk).map(Some)) {
        Ok(sdk) => sdk,
        Err(why) => return refuse(&why, console),
    };
    let beside = language == Language::Rust && folder.join("src/lib.rs").exists();
    let files = if beside { vec![(format!("src/{word}.rs"), NODE)] } else { templates(&name, word, language) };
    let files = files.into_iter().map(|(path, text)| (folder.join(path), fill(text, &name, word, language, sdk.as_deref())));
    let written = super::write_new(&files.collect::<Vec<_>>(), console);
    if written != EXIT_OK {
        return written;
    }
    if beside {
        let kind = camel(word);
        console.say(&format!("add to {}: `mod {word};` and, to `per_frame`, `{word}::{kind}`\n", folder.join("src/lib.rs").display()));
        return EXIT_OK;
    }
    if language == Language::Rust && sdk.is_none() {
        let toml = folder.join("Cargo.toml");
        console.say(&format!(
            "warning: expected Pegbar's source in a folder above, found none: --sdk DIR says where it is; see {}\n",
            toml.display()
        ));
    }
    console.say(&format!("build and check it: cd {} && make check, or as README.md says\n", folder.display()));
    EXIT_OK
}

/// The folder `plugins/sdk` of Pegbar's source: above where the plugin will be, or above this program.
fn find_sdk(folder: &Path) -> Option<PathBuf> {
    let program = std::env::current_exe().ok();
    let above = folder.ancestors().chain(program.iter().flat_map(|p| p.ancestors()));
    above.map(|a| a.join("plugins/sdk")).find(|sdk| sdk.join("Cargo.toml").is_file())
}

/// As [`find_sdk`], of a folder that somebody names: Pegbar's source, its `plugins` or the `sdk` in there.
fn given_sdk(named: &Path) -> Result<PathBuf, String> {
    let places = [named.to_owned(), named.join("sdk"), named.join("plugins/sdk")];
    let found = places.into_iter().find(|sdk| sdk.join("src/border.rs").is_file()).and_then(|sdk| std::path::absolute(sdk).ok());
    found.ok_or_else(|| format!("expected Pegbar's source at {}, found no plugins/sdk there", named.display()))
}

/// Where the library of a language comes to lie.
fn built(language: Language) -> &'static str {
    if language == Language::Rust { "target/release" } else { "build" }
}

fn templates(name: &str, word: &str, language: Language) -> Vec<(String, &'static str)> {
    let mut files = match language {
        Language::Rust => vec![
            ("Cargo.toml".to_owned(), include_str!("plugin/Cargo.toml.txt")),
            ("src/lib.rs".to_owned(), include_str!("plugin/lib.rs.txt")),
            (format!("src/{word}.rs"), NODE),
        ],
        Language::C => vec![(format!("src/{name}.c"), include_str!("plugin/plugin.c")), ("include/pegbar_plugin.h".to_owned(), HEADER)],
        Language::Cpp => vec![
            (format!("src/{name}.cpp"), include_str!("plugin/plugin.cpp")),
            ("include/pegbar_plugin.h".to_owned(), HEADER),
            ("include/pegbar_plugin.hpp".to_owned(), SKELETON),
        ],
    };
    files.push((format!("{name}.ron"), include_str!("plugin/graph.ron")));
    files.push(("Makefile".to_owned(), include_str!("plugin/Makefile.txt")));
    files.push(("README.md".to_owned(), include_str!("plugin/README.md")));
    files.push((".gitignore".to_owned(), "/target\n/build\n/out\n"));
    files
}

fn camel(word: &str) -> String {
    let parts = word.split('_').filter_map(|part| Some((part.chars().next()?.to_ascii_uppercase(), part.get(1..)?)));
    parts.map(|(first, rest)| format!("{first}{rest}")).collect()
}

/// A template with its names filled in.
fn fill(template: &str, name: &str, word: &str, language: Language, sdk: Option<&Path>) -> String {
    let library = format!("{DLL_PREFIX}{name}{DLL_SUFFIX}");
    let sdk = match sdk {
        Some(path) => format!("{{ path = {:?} }}", path.display().to_string().replace('\\', "/")),
        None => format!("{:?}", env!("CARGO_PKG_VERSION")),
    };
    let (source, command, more) = match language {
        Language::Rust => (
            "Cargo.toml $(wildcard src/*.rs)".to_owned(),
            "cargo build --release".to_owned(),
            format!("A node more: `pegbar new node {name}.WORD` in the folder above this one."),
        ),
        Language::C => (
            format!("src/{name}.c include/pegbar_plugin.h"),
            format!("cc -std=c11 -O2 -Wall -Wextra -shared -fPIC -Iinclude -o build/{library} src/{name}.c -lm"),
            "A node more is another entry of `nodes` in the schema; `create` is told its position.".to_owned(),
        ),
        Language::Cpp => (
            format!("src/{name}.cpp include/pegbar_plugin.hpp include/pegbar_plugin.h"),
            format!("c++ -std=c++17 -O2 -Wall -Wextra -shared -fPIC -Iinclude -o build/{library} src/{name}.cpp"),
            "A node more is another entry of `nodes` in the schema; `make` is told its position.".to_owned(),
        ),
    };
    let folder = if language == Language::Rust { "" } else { "mkdir -p build\n" };
    let rule = format!(
        "$(LIBRARY): {source}\n{}\n",
        format!("{folder}{command}").lines().map(|l| format!("\t{l}")).collect::<Vec<_>>().join("\n")
    );
    let commands = format!("{folder}{command}");
    let filled = [
        ("{build}", rule.as_str()),
        ("{commands}", commands.as_str()),
        ("{more}", more.as_str()),
        ("{folder}", built(language)),
        ("{library}", library.as_str()),
        ("{sdk}", sdk.as_str()),
        ("{word}", word),
        ("{Word}", &camel(word)),
        ("{name}", name),
    ];
    filled.into_iter().fold(template.to_owned(), |text, (from, to)| text.replace(from, to))
}
