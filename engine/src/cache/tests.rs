//! The cache under everything that can happen to a folder: it has the right bits or none.

use std::path::Path;
use std::sync::Arc;

use proptest::prelude::*;

use super::log::Data;
use super::*;
use crate::registry::Registry;
use crate::value::{Vector, digest};

/// A type that no registry has.
#[derive(Clone, Debug, PartialEq, crate::Value)]
struct Private {
    /// Singles.
    #[value(shape = "[n]")]
    singles: Vec<f32>,
    /// A name.
    #[value(text)]
    name: String,
}

fn key(n: u64) -> Key {
    *blake3::hash(&n.to_le_bytes()).as_bytes()
}

/// A value of so many numbers, another for each seed.
fn vector(seed: u64, len: usize) -> Vector {
    Vector { values: (0..len).map(|i| f64::from_bits(0x7ff8_0000_0000_0000 | (seed << 20) | i as u64)).collect() }
}

fn id(value: &dyn AnyValue) -> Digest {
    *digest(value).as_bytes()
}

fn types() -> Types {
    Registry::new().shared_types().clone()
}

const SMALL: usize = 5;
const LARGE: usize = 9000;
const LIMIT: u64 = 1 << 30;

fn put(cache: &Cache, n: u64, len: usize) {
    let value = vector(n, len);
    cache.store(&key(n), &id(&value), &value);
}

/// Whether a key has its value. Any other value fails the test.
fn has(cache: &Cache, n: u64, len: usize) -> bool {
    let Some(entry) = cache.find(&key(n)) else { return false };
    assert_eq!(entry, Entry { digest: id(&vector(n, len)), bytes: 8 * len as u64 });
    let Some(value) = cache.load(&key(n), None, &types()) else { return false };
    assert_eq!(id(value.as_ref()), entry.digest, "{n}");
    true
}

fn open(dir: &Path) -> Cache {
    Cache::open(dir, LIMIT).unwrap()
}

fn folder() -> tempfile::TempDir {
    tempfile::tempdir().unwrap()
}

/// Every file below a folder, in order, but for locks.
fn files(dir: &Path) -> Vec<PathBuf> {
    let mut found = Vec::new();
    for entry in std::fs::read_dir(dir).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() { found.extend(files(&path)) } else { found.push(path) }
    }
    found.retain(|p| !p.ends_with("users") && !p.to_string_lossy().ends_with("lock"));
    found.sort();
    found
}

fn only(dir: &Path, kind: &str) -> PathBuf {
    let mut found = files(dir);
    found.retain(|p| p.extension().is_some_and(|e| e == kind));
    assert_eq!(found.len(), 1, "{found:?}");
    found.remove(0)
}

/// Bytes of all files that hold something.
fn on_disk(dir: &Path) -> u64 {
    files(&dir.join("v1")).iter().filter(|p| !p.ends_with("CACHEDIR.TAG")).map(|p| p.metadata().unwrap().len()).sum()
}

#[test]
fn values_come_back_to_the_bit_now_and_after_it_was_opened_again() {
    let dir = folder();
    let private = Private { singles: vec![f32::NAN, -0.0, 1e-45], name: "hat \u{fc}".to_owned() };
    let extra = ValueType::of::<Private>();
    {
        let cache = open(dir.path());
        for (n, len) in [(1, SMALL), (2, LARGE), (3, 0), (4, 8191), (5, 8192)] {
            assert!(!has(&cache, n, len));
            put(&cache, n, len);
            assert!(has(&cache, n, len));
        }
        cache.store(&key(6), &id(&private), &private);
        assert_eq!((cache.usage().stored, cache.usage().found, cache.usage().loaded), (6, 5, 5));
    }
    let cache = open(dir.path());
    for (n, len) in [(1, SMALL), (2, LARGE), (3, 0), (4, 8191), (5, 8192)] {
        assert!(has(&cache, n, len));
    }
    assert!(cache.load(&key(6), None, &types()).is_none(), "a type that nobody knows");
    let back = cache.load(&key(6), Some(&extra), &types()).unwrap();
    assert_eq!(id(back.as_ref()), id(&private));
    assert_eq!(cache.find(&key(7)), None);
    assert_eq!(cache.trouble(), []);
    assert_eq!(cache.bytes(), on_disk(dir.path()));
    let blobs = files(&dir.path().join("v1/blobs"));
    assert_eq!(blobs.len(), 2, "{blobs:?}");
    assert!(
        std::fs::read_to_string(dir.path().join("v1/CACHEDIR.TAG")).unwrap().starts_with("Signature: 8a477f597d28d172789f06886806bc55")
    );
}

#[test]
fn a_value_is_there_once_however_many_keys_it_has() {
    let dir = folder();
    {
        let cache = open(dir.path());
        put(&cache, 1, LARGE);
        let bytes = cache.bytes();
        assert!(cache.link(&key(2), &id(&vector(1, LARGE))));
        cache.store(&key(3), &id(&vector(1, LARGE)), &vector(1, LARGE));
        assert!(!cache.link(&key(4), &id(&vector(9, LARGE))), "bytes that are not there");
        assert!(cache.bytes() < bytes + 500);
    }
    let cache = open(dir.path());
    let found = [1, 2, 3, 4].map(|n| cache.find(&key(n)).map(|e| e.digest));
    let digest = Some(id(&vector(1, LARGE)));
    assert_eq!(found, [digest, digest, digest, None]);
    assert_eq!((cache.stats().values, cache.stats().keys), (1, 3));
}

#[test]
fn the_latest_note_is_recalled() {
    let dir = folder();
    for run in 0..3u8 {
        let cache = open(dir.path());
        assert_eq!(cache.recall(&key(1)), (run > 0).then(|| vec![run - 1, 9]));
        cache.note(&key(1), &[run]);
        cache.note(&key(1), &[run, 9]);
        assert_eq!(cache.recall(&key(1)), Some(vec![run, 9]));
        let bytes = cache.bytes();
        cache.note(&key(1), &[run, 9]);
        assert_eq!(cache.bytes(), bytes, "the same again is not written");
        cache.note(&key(2), &[]);
    }
    assert_eq!(open(dir.path()).recall(&key(2)), Some(Vec::new()));
    assert_eq!(open(dir.path()).recall(&key(3)), None);
}

#[test]
fn one_log_serves_runs_that_follow_each_other() {
    let dir = folder();
    for n in 0..5 {
        put(&open(dir.path()), n, SMALL);
    }
    only(&dir.path().join("v1/index"), "log");
    let cache = open(dir.path());
    assert!((0..5).all(|n| has(&cache, n, SMALL)));
    let (a, b) = (open(dir.path()), open(dir.path()));
    put(&a, 10, SMALL);
    put(&b, 11, SMALL);
    assert_eq!(a.folder.logs().unwrap().len(), 2, "two at once have a log each");
    a.refresh();
    assert!(has(&a, 11, SMALL), "and hear of each other");
}

/// Two handles on a folder, two threads each, at work on the same few keys.
fn at_once(dir: &Path, limit: u64, seed: u64) {
    let handles = [Cache::open(dir, limit).unwrap(), Cache::open(dir, limit).unwrap()];
    std::thread::scope(|scope| {
        for thread in 0..4u64 {
            let cache = &handles[thread as usize % 2];
            scope.spawn(move || {
                let mut state = seed.wrapping_mul(4).wrapping_add(thread) | 1;
                for _ in 0..150 {
                    state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
                    let (n, what) = ((state >> 33) % 12, (state >> 50) % 20);
                    let len = if n % 3 == 0 { LARGE } else { SMALL };
                    match what {
                        0..8 => drop(has(cache, n, len)),
                        8..14 => put(cache, n, len),
                        14 | 15 => drop(cache.link(&key(n), &id(&vector(n, len)))),
                        16 => cache.note(&key(n), &n.to_le_bytes()),
                        17 => assert!(cache.recall(&key(n)).is_none_or(|text| text == n.to_le_bytes())),
                        18 => cache.refresh(),
                        _ => drop(cache.gc(limit / 2)),
                    }
                }
            });
        }
    });
    for cache in &handles {
        let wrong: Vec<Trouble> = cache.trouble().into_iter().filter(|t| !matches!(t, Trouble::Full { .. })).collect();
        assert_eq!(wrong, []);
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(12))]

    #[test]
    fn handles_and_threads_at_once_never_give_a_wrong_value(seed in any::<u64>(), is_tight in any::<bool>()) {
        let dir = folder();
        let limit = if is_tight { 200_000 } else { LIMIT };
        for run in 0..3 {
            at_once(dir.path(), limit, seed ^ run);
        }
        let cache = open(dir.path());
        for n in 0..12 {
            has(&cache, n, if n % 3 == 0 { LARGE } else { SMALL });
        }
        prop_assert_eq!(cache.trouble(), []);
    }
}

/// A record of one of few values, in one of few generations.
fn fact() -> impl Strategy<Value = (u8, u64, u64)> {
    (0u8..4, 0u64..3, 1u64..5)
}

proptest! {
    #[test]
    fn logs_give_the_same_index_in_any_order(facts in prop::collection::vec(fact(), 0..12), seed in any::<u64>()) {
        let data = Arc::new(Data::none());
        let read = |facts: &[(u8, u64, u64)]| {
            let index = Index::default();
            let mut uses = Vec::new();
            for &(kind, n, born) in facts {
                let digest = key(n + 100);
                let held = Held { born, key: key(n), digest, bytes: n, stored: n, at: None, ty: "Vector" };
                match kind {
                    0 => index.apply(&Record::Value(held), &data),
                    1 => index.apply(&Record::Link { key: key(n + 50), digest }, &data),
                    2 => uses.push((digest, born)),
                    _ => index.apply(&Record::Removed { upto: born, digest }, &data),
                }
            }
            index.put_uses(&uses);
            let mut found = Vec::new();
            index.contents.each(|id, c| found.push((*id, c.born, c.used.load(Relaxed).max(c.noted))));
            index.prune();
            index.keys.each(|key, digest| found.push((*key, u64::from(digest[0]), 0)));
            found.sort_unstable();
            (found, index.newest(), index.blob_bytes.load(Relaxed))
        };
        let mut shuffled = facts.clone();
        shuffled.sort_by_key(|f| blake3::hash(&[&seed.to_le_bytes()[..], &[f.0, f.1 as u8, f.2 as u8]].concat()).to_hex().to_string());
        prop_assert_eq!(read(&facts), read(&shuffled));
    }
}

/// A store of every kind of record in one log, its values being 1, 2 and 3, the last of them of so many numbers. Every file of it.
fn store_of(last: usize) -> Vec<(PathBuf, Vec<u8>)> {
    let dir = folder();
    {
        let cache = open(dir.path());
        put(&cache, 1, SMALL);
        cache.note(&key(7), b"written");
        put(&cache, 3, last);
    }
    {
        let cache = open(dir.path());
        assert!(has(&cache, 1, SMALL));
        cache.link(&key(4), &id(&vector(1, SMALL)));
        put(&cache, 2, SMALL);
    }
    let below = |p: &Path| p.strip_prefix(dir.path()).unwrap().to_owned();
    files(dir.path()).into_iter().map(|p| (below(&p), std::fs::read(&p).unwrap())).collect()
}

/// What a store says that was damaged in one file: the right values or none; and it can be stored in again. How many values were right.
fn right_or_none(store: &[(PathBuf, Vec<u8>)], last: usize, damaged: &Path, bytes: &[u8]) -> usize {
    let dir = folder();
    for (path, good) in store {
        let to = dir.path().join(path);
        std::fs::create_dir_all(to.parent().unwrap()).unwrap();
        std::fs::write(to, if path == damaged { bytes } else { good }).unwrap();
    }
    let values = [(1, SMALL), (2, SMALL), (3, last)];
    let cache = open(dir.path());
    let right = values.iter().filter(|(n, len)| has(&cache, *n, *len)).count();
    assert!(cache.recall(&key(7)).is_none_or(|text| text == b"written"));
    assert!(cache.find(&key(4)).is_none_or(|e| e.digest == id(&vector(1, SMALL))));
    values.iter().for_each(|(n, len)| put(&cache, *n, *len));
    assert!(values.iter().all(|(n, len)| has(&cache, *n, *len)));
    drop(cache);
    let cache = open(dir.path());
    assert!(values.iter().all(|(n, len)| has(&cache, *n, *len)), "opened again");
    right
}

fn is_of(path: &Path, kind: &str) -> bool {
    path.extension().is_some_and(|e| e == kind)
}

#[test]
fn a_log_that_was_torn_off_at_any_byte_is_good_up_to_there() {
    let store = store_of(SMALL);
    for (path, good) in store.iter().filter(|(p, _)| is_of(p, "log") || is_of(p, "data")) {
        let mut last = 0;
        for end in 0..=good.len() {
            let right = right_or_none(&store, SMALL, path, &good[..end]);
            assert!(right >= last, "{} torn at {end}: {right} values after {last}", path.display());
            last = right;
        }
        assert_eq!(last, 3);
    }
}

#[test]
fn a_byte_that_is_flipped_anywhere_never_gives_a_wrong_value() {
    for last in [SMALL, LARGE] {
        let store = store_of(last);
        for (path, good) in store.iter().filter(|(p, _)| last == SMALL || is_of(p, "npz")) {
            // Elements of a large array are all alike.
            for at in (0..good.len()).filter(|at| *at < 1500 && last == SMALL || *at < 300 || good.len() - at < 300 || at % 4999 == 0) {
                let mut bytes = good.clone();
                bytes[at] ^= 1 << (at % 8);
                let right = right_or_none(&store, last, path, &bytes);
                assert!(right >= 2, "{} flipped at {at}: {right} of 3 values", path.display());
            }
        }
    }
}

#[test]
fn a_damaged_record_costs_itself_alone_and_is_told() {
    let dir = folder();
    {
        let cache = open(dir.path());
        (0..10).for_each(|n| put(&cache, n, SMALL));
    }
    let path = only(dir.path(), "log");
    let mut bytes = std::fs::read(&path).unwrap();
    let each = bytes.len() / 10;
    bytes[each * 4 + 30] ^= 1;
    std::fs::write(&path, bytes).unwrap();
    let cache = open(dir.path());
    let found: Vec<u64> = (0..10).filter(|n| has(&cache, *n, SMALL)).collect();
    assert_eq!(found, [0, 1, 2, 3, 5, 6, 7, 8, 9]);
    let told = cache.trouble();
    assert_eq!(told, [Trouble::Index { file: path, bytes: each }]);
    assert_eq!(cache.trouble(), [], "told once");
}

#[test]
fn a_damaged_value_is_dropped_told_and_can_be_stored_again() {
    let dir = folder();
    let cache = open(dir.path());
    put(&cache, 1, LARGE);
    let path = only(dir.path(), "npz");
    let mut bytes = std::fs::read(&path).unwrap();
    let middle = bytes.len() / 2;
    bytes[middle] ^= 1;
    std::fs::write(&path, &bytes).unwrap();
    assert!(cache.find(&key(1)).is_some());
    assert!(cache.load(&key(1), None, &types()).is_none());
    assert_eq!((cache.find(&key(1)), path.exists(), cache.usage().damaged), (None, false, 1));
    let told = cache.trouble();
    assert_eq!(told.len(), 1, "{told:?}");
    let text = told[0].to_string();
    let hex = digest(&vector(1, LARGE)).to_hex();
    assert!(
        text.contains(&format!("expected the Vector {hex}, found ")) && text.ends_with("it was dropped, and is computed again"),
        "{text}"
    );
    put(&cache, 1, LARGE);
    assert!(has(&cache, 1, LARGE));
    drop(cache);
    let cache = open(dir.path());
    assert!(has(&cache, 1, LARGE), "what was stored after it was dropped stays");
    // Sound by itself, and not what it is said to be.
    let mut other = Cursor::new(Vec::new());
    npz::write(&vector(2, LARGE), false, &mut other).unwrap();
    std::fs::write(&path, other.into_inner()).unwrap();
    assert!(cache.load(&key(1), None, &types()).is_none());
    assert!(cache.trouble()[0].to_string().contains("found other bits"));
}

#[test]
fn a_value_that_another_removed_is_lost_without_a_word() {
    let dir = folder();
    let cache = open(dir.path());
    put(&cache, 1, LARGE);
    std::fs::remove_file(only(dir.path(), "npz")).unwrap();
    assert!(cache.find(&key(1)).is_some());
    assert!(!has(&cache, 1, LARGE));
    assert_eq!((cache.usage().lost, cache.trouble()), (1, vec![]));
    put(&cache, 1, LARGE);
    assert!(has(&cache, 1, LARGE));
}

#[test]
fn a_folder_that_vanishes_ends_storing_and_nothing_else() {
    let dir = folder();
    let cache = open(dir.path());
    put(&cache, 1, SMALL);
    put(&cache, 2, LARGE);
    std::fs::remove_dir_all(dir.path().join("v1")).unwrap();
    assert!(!has(&cache, 2, LARGE));
    for n in 3..6 {
        put(&cache, n, LARGE);
        put(&cache, n + 10, SMALL);
        assert!(!has(&cache, n, LARGE));
        cache.note(&key(n), b"x");
    }
    let told = cache.trouble();
    assert!(matches!(&told[..], [Trouble::Stopped { .. }]), "{told:?}");
    assert_eq!(cache.trouble(), []);
    cache.gc(0);
    drop(cache);
    assert!(!exists(dir.path()), "it does not come back by half");
    let cache = open(dir.path());
    put(&cache, 1, SMALL);
    std::fs::remove_dir_all(dir.path().join("v1")).unwrap();
    put(&cache, 2, SMALL);
    assert!(matches!(&cache.trouble()[..], [Trouble::Stopped { .. }]), "small values alone are told of too");
}

#[test]
fn what_is_no_folder_is_refused_by_name() {
    let dir = folder();
    let path = dir.path().join("file");
    std::fs::write(&path, "precious").unwrap();
    let error = Cache::open(&path, LIMIT).unwrap_err().to_string();
    assert!(error.starts_with(&format!("{}: opening failed: expected a folder, found a file", path.display())), "{error}");
    let error = Cache::open(&path.join("below"), LIMIT).unwrap_err().to_string();
    assert!(error.contains("making the folder failed"), "{error}");
    assert_eq!(std::fs::read_to_string(&path).unwrap(), "precious");
    let odd = dir.path().join("odd");
    std::fs::create_dir_all(odd.join("v1")).unwrap();
    std::fs::write(odd.join("v1/index"), "").unwrap();
    assert!(Cache::open(&odd, LIMIT).is_err(), "a file in the place of the index");
}

#[test]
fn an_unreadable_log_is_told_and_left_alone() {
    let dir = folder();
    put(&open(dir.path()), 1, SMALL);
    std::fs::create_dir(dir.path().join("v1/index/odd.log")).unwrap();
    let cache = open(dir.path());
    assert!(has(&cache, 1, SMALL));
    put(&cache, 2, SMALL);
    assert!(has(&cache, 2, SMALL));
    let told = cache.trouble();
    assert!(!told.is_empty() && told.iter().all(|t| matches!(t, Trouble::Unread { .. })), "{told:?}");
    drop(cache);
    assert!(has(&open(dir.path()), 2, SMALL));
}

/// A file system of its own, gone with the value.
#[cfg(target_os = "linux")]
struct Mount(tempfile::TempDir);

#[cfg(target_os = "linux")]
impl Mount {
    /// `None` where this process may not mount anything; the test then says that it was skipped.
    fn new(options: &str) -> Option<Self> {
        let dir = folder();
        let mounted = std::process::Command::new("mount").args(["-t", "tmpfs", "-o", options, "tmpfs"]).arg(dir.path()).output();
        if mounted.is_ok_and(|o| o.status.success()) {
            return Some(Self(dir));
        }
        eprintln!("skipped: no file system may be mounted here");
        None
    }

    fn again(&self, options: &str) {
        let options = format!("remount,{options}");
        assert!(std::process::Command::new("mount").args(["-o", &options]).arg(self.0.path()).status().unwrap().success());
    }
}

#[cfg(target_os = "linux")]
impl Drop for Mount {
    fn drop(&mut self) {
        let _ = std::process::Command::new("umount").arg(self.0.path()).status();
    }
}

#[cfg(target_os = "linux")]
#[test]
fn a_read_only_folder_gives_what_it_has() {
    let Some(mount) = Mount::new("size=4m") else { return };
    let dir = mount.0.path();
    {
        let cache = open(dir);
        put(&cache, 1, SMALL);
        put(&cache, 2, LARGE);
    }
    mount.again("ro");
    let cache = open(dir);
    assert!(has(&cache, 1, SMALL) && has(&cache, 2, LARGE));
    assert_eq!(cache.trouble(), [], "nothing was to be written");
    put(&cache, 3, SMALL);
    put(&cache, 4, LARGE);
    cache.note(&key(5), b"x");
    assert!(!has(&cache, 3, SMALL) && !has(&cache, 4, LARGE));
    let told = cache.trouble();
    assert!(matches!(&told[..], [Trouble::Stopped { .. }]), "{told:?}");
    assert!(told[0].to_string().contains("Read-only file system"), "{told:?}");
    drop(cache);
    std::fs::read_dir(dir.join("v1/index")).unwrap().for_each(|e| drop(e.unwrap()));
    mount.again("rw");
}

#[cfg(target_os = "linux")]
#[test]
fn a_full_disk_has_old_values_removed_and_then_ends_storing() {
    let Some(mount) = Mount::new("size=1m") else { return };
    let dir = mount.0.path();
    {
        let cache = open(dir);
        (0..8).for_each(|n| put(&cache, n, LARGE));
        assert_eq!(cache.trouble(), []);
    }
    let cache = open(dir);
    assert!(has(&cache, 7, LARGE));
    (10..30).for_each(|n| {
        put(&cache, n, LARGE);
        put(&cache, n + 100, SMALL);
    });
    let told = cache.trouble();
    assert!(matches!(&told[..], [Trouble::Stopped { .. }]), "{told:?}");
    assert!(told[0].to_string().contains("No space left on device"), "{told:?}");
    let old = (0..8).filter(|n| has(&cache, *n, LARGE)).count();
    let new = (10..30).filter(|n| has(&cache, *n, LARGE)).count();
    assert!((1..8).contains(&old) && (3..20).contains(&new), "{old} old, {new} new");
    assert!(has(&cache, 7, LARGE), "what this run used stays");
    drop(cache);
    let cache = open(dir);
    assert_eq!((10..30).filter(|n| has(&cache, *n, LARGE)).count(), new);
    assert!(files(&dir.join("v1/tmp")).is_empty());
    assert_eq!(cache.trouble(), []);
}

#[test]
fn the_bound_is_kept_and_what_was_not_used_for_longest_goes_first() {
    let dir = folder();
    // Room for ten large values.
    let limit = 10 * (8 * LARGE as u64 + OVERHEAD);
    for run in 0..6u64 {
        let cache = Cache::open(dir.path(), limit).unwrap();
        // The first of all is used in every run.
        assert_eq!(has(&cache, 0, LARGE), run > 0);
        put(&cache, 0, LARGE);
        for n in 1..4 {
            put(&cache, run * 10 + n, LARGE);
            assert!(cache.bytes() <= limit);
        }
        assert_eq!(cache.trouble(), []);
        assert!(on_disk(dir.path()) <= limit, "{} of {limit}", on_disk(dir.path()));
        assert_eq!(cache.bytes(), on_disk(dir.path()));
    }
    let cache = open(dir.path());
    let left: Vec<u64> = (0..60).filter(|n| has(&cache, *n, LARGE)).collect();
    assert!(left.len() >= 7 && left[0] == 0 && left.ends_with(&[41, 42, 43, 51, 52, 53]), "{left:?}");
}

#[test]
fn what_a_run_stored_or_used_stays_and_the_rest_is_told_not_to_fit() {
    let dir = folder();
    let limit = 10 * (8 * LARGE as u64 + OVERHEAD);
    put(&Cache::open(dir.path(), limit).unwrap(), 100, LARGE);
    let cache = Cache::open(dir.path(), limit).unwrap();
    assert!(cache.find(&key(100)).is_some());
    (0..30).for_each(|n| put(&cache, n, LARGE));
    let told = cache.trouble();
    assert_eq!(told, [Trouble::Full { folder: dir.path().join("v1"), limit }]);
    assert!(has(&cache, 100, LARGE) && (0..8).all(|n| has(&cache, n, LARGE)));
    assert!(on_disk(dir.path()) <= limit);
    cache.store(&key(200), &id(&vector(200, 12 * LARGE)), &vector(200, 12 * LARGE));
    cache.store(&key(201), &id(&vector(201, 12 * LARGE)), &vector(201, 12 * LARGE));
    let told = cache.trouble();
    assert!(matches!(&told[..], [Trouble::TooLarge { .. }]), "{told:?}");
}

#[test]
fn small_values_give_their_room_back_too() {
    let dir = folder();
    let limit = 200_000;
    for run in 0..8u64 {
        let cache = Cache::open(dir.path(), limit).unwrap();
        for n in 0..60 {
            put(&cache, run * 100 + n, 100);
            if n % 10 == 0 {
                cache.note(&key(run * 100 + n), &[7; 100]);
            }
        }
        assert_eq!(cache.trouble(), [], "run {run}");
        assert!((0..60).all(|n| has(&cache, run * 100 + n, 100)), "run {run}");
        assert!(on_disk(dir.path()) <= limit, "run {run}: {} of {limit}", on_disk(dir.path()));
    }
    let cache = open(dir.path());
    let left = (0..800).filter(|n| has(&cache, *n, 100)).count();
    assert!((80..150).contains(&left), "{left}");
}

#[test]
fn removal_reads_no_clock() {
    let order = |times: [u64; 3]| {
        let dir = folder();
        for n in 0..3u64 {
            put(&open(dir.path()), n, LARGE);
            let time = std::time::UNIX_EPOCH + std::time::Duration::from_secs(times[n as usize]);
            for path in files(dir.path()) {
                File::options().append(true).open(path).unwrap().set_modified(time).unwrap();
            }
        }
        open(dir.path()).gc(2 * 8 * LARGE as u64 + 4000);
        let cache = open(dir.path());
        [0, 1, 2].map(|n| has(&cache, n, LARGE))
    };
    assert_eq!(order([1, 2, 3]), [false, true, true]);
    assert_eq!(order([4_000_000_000, 2, 1]), [false, true, true]);
}

#[test]
fn a_reader_lives_through_collection_by_another() {
    let dir = folder();
    {
        let cache = open(dir.path());
        (0..4).for_each(|n| put(&cache, n, if n < 2 { SMALL } else { LARGE }));
    }
    let reader = open(dir.path());
    assert!(reader.find(&key(0)).is_some() && reader.find(&key(2)).is_some());
    let freed = open(dir.path()).gc(0);
    assert_eq!((freed.values, freed.left), (4, 0));
    // Its index still says so; the bytes are there as long as the system keeps them, or not at all.
    for n in 0..4 {
        has(&reader, n, if n < 2 { SMALL } else { LARGE });
    }
    assert!(!has(&reader, 2, LARGE));
    put(&reader, 2, LARGE);
    assert!(has(&reader, 2, LARGE));
    assert_eq!(reader.trouble(), []);
    drop(reader);
    assert!(has(&open(dir.path()), 2, LARGE));
}

#[test]
fn collection_keeps_what_is_alive_and_what_others_write() {
    let dir = folder();
    {
        let (a, b) = (open(dir.path()), open(dir.path()));
        (0..20).for_each(|n| put(if n % 2 == 0 { &a } else { &b }, n, if n % 5 == 0 { LARGE } else { SMALL }));
        a.link(&key(30), &id(&vector(2, SMALL)));
        b.note(&key(31), b"kept");
    }
    let stray = [dir.path().join("v1/tmp/.value.x.part"), dir.path().join("v1/blobs/ab")];
    std::fs::write(&stray[0], "torn").unwrap();
    std::fs::create_dir_all(&stray[1]).unwrap();
    std::fs::write(stray[1].join(format!("{}.npz", "ab".repeat(32))), "torn").unwrap();
    let writer = open(dir.path());
    put(&writer, 40, SMALL);
    let all = |cache: &Cache| (0..20).all(|n| has(cache, n, if n % 5 == 0 { LARGE } else { SMALL })) && has(cache, 40, SMALL);
    open(dir.path()).gc(LIMIT);
    assert!(stray[0].exists(), "another may be writing it");
    assert!(all(&open(dir.path())));
    put(&writer, 41, SMALL);
    drop(writer);
    assert!(has(&open(dir.path()), 41, SMALL));
    open(dir.path()).gc(LIMIT);
    assert!(!stray[0].exists() && std::fs::read_dir(&stray[1]).unwrap().count() == 0);
    only(dir.path(), "log");
    let cache = open(dir.path());
    assert!(all(&cache));
    assert!(cache.find(&key(30)).is_some());
    assert_eq!(cache.recall(&key(31)), Some(b"kept".to_vec()));
    assert_eq!(cache.trouble(), []);
}

#[test]
fn copies_keep_the_generation_of_the_last_use() {
    let dir = folder();
    (0..4).for_each(|n| put(&open(dir.path()), n, SMALL));
    assert!(has(&open(dir.path()), 0, SMALL));
    open(dir.path()).gc(LIMIT);
    let size = on_disk(dir.path());
    open(dir.path()).gc(size / 2);
    let cache = open(dir.path());
    let left = [0, 1, 2, 3].map(|n| has(&cache, n, SMALL));
    assert_eq!((left[0], left[1]), (true, false), "{left:?}");
}

#[test]
fn verification_finds_what_is_damaged_and_forgets_it() {
    let dir = folder();
    {
        let cache = open(dir.path());
        (0..3).for_each(|n| put(&cache, n, LARGE));
        put(&cache, 3, SMALL);
        let private = Private { singles: vec![1.0], name: "x".to_owned() };
        cache.store(&key(4), &id(&private), &private);
    }
    let blob = |n: u64| Folder(dir.path().join("v1")).blob(&id(&vector(n, LARGE)));
    std::fs::write(blob(0), "no archive").unwrap();
    std::fs::remove_file(blob(1)).unwrap();
    let cache = open(dir.path());
    let mut told = Vec::new();
    assert_eq!(cache.verify(|t| told.push(t.to_string())), 3, "private types too");
    assert_eq!(told.len(), 2, "{told:?}");
    assert!(
        told.iter().any(|t| t.contains("found nothing")) && told.iter().any(|t| t.contains("found an archive that cannot be read")),
        "{told:?}"
    );
    assert!(!blob(0).exists());
    drop(cache);
    assert_eq!(open(dir.path()).verify(|t| panic!("{t}")), 3);
}

#[test]
fn statistics_say_what_is_there_and_clearing_leaves_nothing() {
    let dir = folder();
    std::fs::write(dir.path().join("mine.txt"), "mine").unwrap();
    {
        let cache = open(dir.path());
        put(&cache, 1, LARGE);
        put(&cache, 2, SMALL);
        cache.note(&key(3), b"x");
    }
    assert!(has(&open(dir.path()), 2, SMALL));
    let cache = open(dir.path());
    let stats = cache.stats();
    assert_eq!((stats.values, stats.keys, stats.notes, stats.bytes), (2, 2, 1, on_disk(dir.path())));
    assert_eq!((stats.oldest, stats.newest), (1, 2));
    assert_eq!(stats.types["Vector"].values, 2);
    assert!(stats.types["Vector"].bytes > 8 * LARGE as u64 && stats.types["Vector"].bytes < stats.bytes);
    drop(cache);
    assert_eq!(clear(dir.path()).unwrap(), Freed { values: 2, bytes: stats.bytes, left: 0 });
    assert!(!exists(dir.path()) && dir.path().join("mine.txt").exists());
    assert_eq!(clear(dir.path()).unwrap(), Freed::default());
}

#[test]
fn the_users_own_folder_follows_the_environment() {
    let with = |vars: &[(&str, &str)]| {
        let vars: Vec<(String, OsString)> = vars.iter().map(|(n, v)| ((*n).to_owned(), OsString::from(v))).collect();
        default_dir_in(|name| vars.iter().find(|(n, _)| n == name).map(|(_, v)| v.clone()))
    };
    assert_eq!(with(&[("PEGBAR_CACHE", "here"), ("HOME", "/h")]), Some("here".into()));
    assert_eq!(with(&[("PEGBAR_CACHE", "")]), None);
    if cfg!(all(unix, not(target_os = "macos"))) {
        assert_eq!(with(&[("HOME", "/h")]), Some("/h/.cache/pegbar".into()));
        assert_eq!(with(&[("XDG_CACHE_HOME", "/x"), ("HOME", "/h")]), Some("/x/pegbar".into()));
        assert_eq!(with(&[("XDG_CACHE_HOME", "x"), ("HOME", "/h")]), Some("/h/.cache/pegbar".into()));
    }
}
