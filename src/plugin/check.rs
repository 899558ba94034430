//! `pegbar plugin check`: a plugin against its contract. Its code runs in a process of its own, which may crash or hang without harm.

use std::io::{BufRead, BufReader, Write};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, ExitStatus, Stdio};
use std::sync::mpsc::{Receiver, RecvTimeoutError, channel};
use std::time::{Duration, Instant};

use pegbar_engine::check::code;
use pegbar_engine::plugin::conform::{CHECKS, Finding, Outcome, Probe, texts};
use pegbar_engine::plugin::{Description, ENDING, Manifest, PluginError, digest, found_in};
use pegbar_engine::registry::Registry;
use serde::{Deserialize, Serialize};

use crate::args::{Format, PluginCheckArgs, PluginProbeArgs};
use crate::console::{Console, EXIT_FAILED, EXIT_OK, EXIT_WRONG, count};

/// What the process with the plugin's code says, one a line.
#[derive(Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
enum Said {
    /// It loaded the library, which holds this, as RON.
    Loaded(String),
    /// It did not.
    Refused { message: String, help: Option<String> },
    /// The check at this position begins.
    Begins(usize),
    /// What comes next.
    At(String),
    /// What came of the check.
    Ends(Finding),
}

/// Every check that runs code, in order: position of the node and name.
fn cases(plugin: &Description) -> Vec<(usize, &'static str)> {
    (0..plugin.nodes.len()).flat_map(|node| CHECKS.iter().map(move |(name, _)| (node, *name))).collect()
}

/// The process with the plugin's code: runs the checks from a position on.
pub(super) fn probe(args: &PluginProbeArgs, registry: &Registry, console: &mut Console) -> u8 {
    let mut tell = |said: &Said| {
        if let Ok(text) = serde_json::to_string(said) {
            // A plugin may have left a line unfinished.
            console.out(&format!("\n{text}\n"));
        }
    };
    let probe = match Probe::load(&args.library, registry, given(&args.set)) {
        Ok(probe) => probe,
        Err(PluginError { message, help }) => {
            tell(&Said::Refused { message, help });
            return EXIT_WRONG;
        }
    };
    tell(&Said::Loaded(probe.description().to_ron()));
    for (at, (node, check)) in cases(probe.description()).into_iter().enumerate().skip(args.from) {
        tell(&Said::Begins(at));
        let out = std::sync::Mutex::new(std::io::stdout());
        let say = |what: &str| {
            if let (Ok(text), Ok(mut out)) = (serde_json::to_string(&Said::At(what.to_owned())), out.lock()) {
                let _ = writeln!(out, "\n{text}").and_then(|()| out.flush());
            }
        };
        if let Some(finding) = probe.check(check, node, &say) {
            tell(&Said::Ends(finding));
        }
    }
    EXIT_OK
}

fn given(set: &[(String, String)]) -> Vec<(String, String, String)> {
    let one =
        |(name, value): &(String, String)| name.rsplit_once('.').map(|(node, input)| (node.to_owned(), input.to_owned(), value.clone()));
    set.iter().filter_map(one).collect()
}

/// The library that a path means, and the manifests of it.
fn resolve(path: &Path) -> Result<(PathBuf, Vec<(PathBuf, Manifest)>), PluginError> {
    if path.to_string_lossy().ends_with(ENDING) {
        let manifest = Manifest::read(path)?;
        let (library, _) = manifest.library(path.parent().unwrap_or(Path::new("")))?;
        return Ok((library, vec![(path.to_owned(), manifest)]));
    }
    let (file, folder) = (path.file_name().unwrap_or_default().to_string_lossy(), path.parent().unwrap_or(Path::new("")));
    let folder = if folder.as_os_str().is_empty() { Path::new(".") } else { folder };
    let beside = found_in(&[folder.to_owned()]).0.into_iter().map(|found| (found.path, found.manifest.as_ref().clone()));
    let of_it = beside.filter(|(_, manifest)| manifest.library(folder).is_ok_and(|(library, _)| library.file_name() == path.file_name()));
    match path.is_file() {
        true => Ok((path.to_owned(), of_it.collect())),
        false => Err(PluginError {
            message: format!("expected a library or a manifest, found no file {file} at {}", folder.display()),
            help: None,
        }),
    }
}

/// Whether the manifest is that of the library.
fn manifest(library: &Path, manifests: &[(PathBuf, Manifest)], plugin: &Description) -> Finding {
    let help = format!("`pegbar plugin manifest {}` writes it", library.display());
    let failed = |found: String| Finding::failed("manifest", None, found, Some(help.clone()));
    let Some((path, manifest)) = manifests.first() else {
        return failed(format!("expected {}{ENDING} beside the library, found none that names it", plugin.name));
    };
    let at = path.display();
    let expected = manifest.library(Path::new("")).map(|(_, digest)| digest.to_owned()).unwrap_or_default();
    match (manifest.plugin.difference(plugin), digest(library)) {
        (_, Err(error)) => failed(error.message),
        (_, Ok(found)) if found != expected => failed(format!("{at}: expected the library's digest {found:.16}, found {expected:.16}")),
        (Some((what, ours, theirs)), _) => failed(format!("{at}: {what}: expected {theirs}, as the library says, found {ours}")),
        (None, _) => Finding::passed("manifest", None),
    }
}

/// Shows findings as they come.
struct Report<'a, 'c> {
    console: &'a mut Console<'c>,
    format: Format,
    findings: Vec<Finding>,
}

impl Report<'_, '_> {
    fn add(&mut self, finding: Finding) {
        if self.format == Format::Text {
            let word = match finding.outcome {
                Outcome::Passed => "ok",
                Outcome::Failed => "FAILED",
                Outcome::NotTried => "not tried",
            };
            let of = finding.node.as_ref().map(|node| format!("{node} ")).unwrap_or_default();
            let found = if finding.found.is_empty() { String::new() } else { format!(": {}", finding.found) };
            let help = finding.help.as_ref().map(|help| format!("{:<11}help: {help}\n", "")).unwrap_or_default();
            self.console.out(&format!("{word:<9}  {of}{}{found}\n{help}", finding.check));
        }
        self.findings.push(finding);
    }

    fn number(&self, outcome: Outcome) -> usize {
        self.findings.iter().filter(|f| f.outcome == outcome).count()
    }

    fn end(self, library: &Path, plugin: Option<&Description>) -> u8 {
        let [passed, failed, not_tried] = [Outcome::Passed, Outcome::Failed, Outcome::NotTried].map(|outcome| self.number(outcome));
        if self.format == Format::Json {
            let (name, version) = plugin.map(|p| (&p.name, &p.version)).unzip();
            let (library, findings) = (library.display().to_string(), &self.findings);
            self.console.json(&serde_json::json!({
                "plugin": name, "version": version, "library": library, "passed": passed, "failed": failed, "not_tried": not_tried, "findings": findings,
            }));
        } else {
            let all = count(self.findings.len(), "check");
            self.console.out(&format!("{}: {all}: {passed} passed, {failed} failed, {not_tried} not tried\n", library.display()));
        }
        if failed > 0 { EXIT_FAILED } else { EXIT_OK }
    }
}

pub(super) fn check(args: &PluginCheckArgs, console: &mut Console) -> u8 {
    let (library, manifests) = match resolve(&args.path) {
        Ok(resolved) => resolved,
        Err(error) => {
            super::say(code::PLUGIN, &error, console);
            return EXIT_WRONG;
        }
    };
    let mut report = Report { console, format: args.format, findings: Vec::new() };
    let mut run = Run { args, library: &library, plugin: None, next: 0 };
    while run.once(&mut report, &manifests) {}
    report.end(&library, run.plugin.as_ref())
}

/// The checks that run code, in as many processes as it takes.
struct Run<'a> {
    args: &'a PluginCheckArgs,
    library: &'a Path,
    plugin: Option<Description>,
    next: usize,
}

impl Run<'_> {
    /// One process; false where nothing is left to do.
    fn once(&mut self, report: &mut Report, manifests: &[(PathBuf, Manifest)]) -> bool {
        let (mut child, lines) = match self.start() {
            Ok(started) => started,
            Err(error) => {
                report.add(Finding::failed("library", None, format!("a process for it: {error}"), None));
                return false;
            }
        };
        let limit = Duration::from_secs(self.args.timeout);
        let (mut at, mut deadline) = (None, Instant::now() + limit);
        let ended = loop {
            match lines.recv_timeout(deadline.saturating_duration_since(Instant::now())) {
                Ok(Said::Loaded(text)) => {
                    if let (None, Ok(plugin)) = (&self.plugin, Description::parse(&text)) {
                        report.add(Finding::passed("library", None));
                        report.add(manifest(self.library, manifests, &plugin));
                        texts(&plugin).into_iter().for_each(|finding| report.add(finding));
                        self.plugin = Some(plugin);
                    }
                }
                Ok(Said::Refused { message, help }) => report.add(Finding::failed("library", None, message, help)),
                Ok(Said::Begins(case)) => {
                    (self.next, at, deadline) = (case + 1, Some(String::new()), Instant::now() + limit);
                }
                Ok(Said::At(what)) => at = Some(what),
                Ok(Said::Ends(finding)) => {
                    at = None;
                    report.add(finding);
                }
                Err(RecvTimeoutError::Timeout) => {
                    let _ = child.kill();
                    break format!("expected an end within {} s, found none", limit.as_secs());
                }
                Err(RecvTimeoutError::Disconnected) => break how_it_ended(&mut child),
            }
        };
        let _ = child.wait();
        let refused = self.plugin.is_none() && !report.findings.is_empty();
        match (&self.plugin, at) {
            (None, _) if !refused => report.add(Finding::failed("library", None, format!("while it was loaded: {ended}"), None)),
            (Some(plugin), Some(at)) => {
                let cases = cases(plugin);
                let (node, check) = cases[(self.next - 1).min(cases.len() - 1)];
                let at = if at.is_empty() { String::new() } else { format!("{at}: ") };
                let help = "the process with the plugin's code is gone, as a run's would be".to_owned();
                report.add(Finding::failed(check, Some(&plugin.nodes[node].id), format!("{at}{ended}"), Some(help)));
                return self.next < cases.len();
            }
            _ => {}
        }
        false
    }

    fn start(&self) -> std::io::Result<(Child, Receiver<Said>)> {
        let mut command = Command::new(std::env::current_exe()?);
        command.args(["plugin", "probe"]).arg(self.library).args(["--from", &self.next.to_string()]);
        for (name, value) in &self.args.set {
            command.arg("--set").arg(format!("{name}={value}"));
        }
        let mut child = command.stdin(Stdio::null()).stdout(Stdio::piped()).stderr(Stdio::null()).spawn()?;
        let (to, from) = channel();
        let out = child.stdout.take();
        std::thread::spawn(move || {
            let lines = out.into_iter().flat_map(|out| BufReader::new(out).split(b'\n').map_while(Result::ok));
            // Lines that are none of these are the plugin's own.
            let said = lines.filter_map(|line| serde_json::from_slice(&line).ok());
            said.map_while(|said| to.send(said).ok()).for_each(drop);
        });
        Ok((child, from))
    }
}

/// How a process ended that should have gone on.
fn how_it_ended(child: &mut Child) -> String {
    let status = child.wait().ok();
    match status.and_then(signal) {
        Some(number) => format!("expected an answer, found a crash: signal {number} ({})", signal_name(number)),
        None => format!("expected an answer, found the process ended ({})", status.map(|s| s.to_string()).unwrap_or_default()),
    }
}

#[cfg(unix)]
fn signal(status: ExitStatus) -> Option<i32> {
    std::os::unix::process::ExitStatusExt::signal(&status)
}

#[cfg(not(unix))]
fn signal(_: ExitStatus) -> Option<i32> {
    None
}

fn signal_name(number: i32) -> &'static str {
    match number {
        4 => "illegal instruction",
        6 => "abort",
        7 => "bus error",
        8 => "arithmetic",
        9 => "killed",
        11 => "memory that it may not touch",
        _ => "see `kill -l`",
    }
}
