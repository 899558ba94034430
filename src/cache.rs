//! `pegbar cache`: what is kept from run to run, and how it is cut down, checked and removed.

use std::path::{Path, PathBuf};

use pegbar_engine::cache::{self, Cache, CacheError, DEFAULT_LIMIT, Stats};
use serde::Serialize;

use crate::args::{CacheCommand, CacheFolder, Format};
use crate::console::{Console, EXIT_FAILED, EXIT_OK, EXIT_WRONG, count};
use crate::summary::{bytes, table};

/// What `pegbar cache stats --format json` prints.
#[derive(Serialize)]
struct Shown {
    folder: PathBuf,
    #[serde(flatten)]
    stats: Stats,
    limit: u64,
}

pub(crate) fn cache(command: &CacheCommand, console: &mut Console) -> u8 {
    let folder = match command {
        CacheCommand::Stats { folder, .. } | CacheCommand::Gc { folder, .. } => folder,
        CacheCommand::Verify { folder } | CacheCommand::Clear { folder } => folder,
    };
    let Some(dir) = chosen(folder) else {
        console.say("error: expected a folder for the cache, found neither one for this user nor the variable PEGBAR_CACHE; name it with --cache DIR\n");
        return EXIT_WRONG;
    };
    let done = match command {
        CacheCommand::Stats { format, .. } => stats(dir, *format, console),
        CacheCommand::Gc { to, .. } => gc(&dir, *to, console),
        CacheCommand::Verify { .. } => verify(&dir, console),
        CacheCommand::Clear { .. } => clear(&dir, console),
    };
    done.unwrap_or_else(|error| {
        console.say(&format!("error: {error}\n"));
        EXIT_FAILED
    })
}

pub(crate) fn chosen(folder: &CacheFolder) -> Option<PathBuf> {
    folder.cache.clone().or_else(cache::default_dir)
}

/// The cache in a folder; `None` where there is none, which makes none.
pub(crate) fn open(dir: &Path) -> Result<Option<Cache>, CacheError> {
    let is_free = !dir.exists() || (dir.is_dir() && !cache::exists(dir));
    if is_free { Ok(None) } else { Cache::open(dir, DEFAULT_LIMIT).map(Some) }
}

fn say_trouble(cache: &Cache, console: &mut Console) {
    cache.trouble().iter().for_each(|t| console.say(&format!("warning: {t}\n")));
}

fn stats(dir: PathBuf, format: Format, console: &mut Console) -> Result<u8, CacheError> {
    let mut stats = Stats::default();
    if let Some(cache) = open(&dir)? {
        stats = cache.stats();
        say_trouble(&cache, console);
    }
    if format == Format::Json {
        return Ok(console.json(&Shown { folder: dir, stats, limit: DEFAULT_LIMIT }));
    }
    let values = format!("{}, {}, {}", counted(stats.values, "value"), counted(stats.keys, "key"), counted(stats.notes, "note"));
    let mut text = format!("{}\n{values}\n{} of at most {}\n", dir.display(), bytes(stats.bytes), bytes(DEFAULT_LIMIT));
    if stats.values > 0 {
        text += &format!("last used in generations {} to {}, of which each run is one\n\n", stats.oldest, stats.newest);
        let head = ["type", "", "values", "on disk"].map(str::to_owned).to_vec();
        let rows = stats.types.iter().map(|(name, t)| vec![name.clone(), String::new(), t.values.to_string(), bytes(t.bytes)]);
        text += &table(&std::iter::once(head).chain(rows).collect::<Vec<_>>());
    }
    console.out(&text);
    Ok(EXIT_OK)
}

fn counted(n: u64, what: &str) -> String {
    count(usize::try_from(n).unwrap_or(usize::MAX), what)
}

fn gc(dir: &Path, to: u64, console: &mut Console) -> Result<u8, CacheError> {
    let freed = match open(dir)? {
        None => cache::Freed::default(),
        Some(cache) => {
            let freed = cache.gc(to);
            say_trouble(&cache, console);
            freed
        }
    };
    console.out(&format!("removed {}, {}; {} left\n", counted(freed.values, "value"), bytes(freed.bytes), bytes(freed.left)));
    if freed.left <= to {
        return Ok(EXIT_OK);
    }
    console.say("warning: another process writes to the cache: what that holds goes when it is done\n");
    Ok(EXIT_FAILED)
}

fn verify(dir: &Path, console: &mut Console) -> Result<u8, CacheError> {
    let (mut sound, mut damaged) = (0, 0);
    if let Some(cache) = open(dir)? {
        sound = cache.verify(|trouble| {
            damaged += 1;
            console.say(&format!("warning: {trouble}\n"));
        });
        say_trouble(&cache, console);
    }
    console.out(&format!("{} sound, {damaged} removed\n", counted(sound, "value")));
    Ok(if damaged == 0 { EXIT_OK } else { EXIT_FAILED })
}

fn clear(dir: &Path, console: &mut Console) -> Result<u8, CacheError> {
    open(dir)?;
    let freed = cache::clear(dir)?;
    console.out(&format!("removed {}, {}\n", counted(freed.values, "value"), bytes(freed.bytes)));
    Ok(EXIT_OK)
}
