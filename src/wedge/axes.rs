//! What a wedge ranges over: lists and ranges of values, and every combination of them.

/// Variants of one wedge at most.
const MOST: usize = 1000;

/// A parameter or an input, with its values as the command line would give them one by one.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Axis {
    /// `node.input`, or the name of a parameter.
    pub(super) name: String,
    /// True for a parameter of the graph.
    pub(super) is_variable: bool,
    pub(super) values: Vec<String>,
}

/// One combination.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Variant {
    /// For each axis, which of its values.
    pub(super) picks: Vec<usize>,
    /// Name of its folder.
    pub(super) folder: String,
}

impl Axis {
    /// Reads `4`, `1,2,4`, `1..5x2` or `0..1/5`, or several of these with commas.
    pub(super) fn new(name: &str, text: &str, is_variable: bool) -> Result<Self, String> {
        let mut values = Vec::new();
        for part in parts(text) {
            let part = part.trim();
            if part.is_empty() {
                return Err(format!("expected values as a,b,c or a range as 1..5x2 or 0..1/5 for `{name}`, found `{text}`"));
            }
            match range(part) {
                Some(range) => values.extend(range.map_err(|why| format!("{why} for `{name}`, found `{part}`"))?),
                None => values.push(part.to_owned()),
            }
        }
        Ok(Self { name: name.to_owned(), is_variable, values })
    }

    /// True where it has more than one value.
    pub(super) fn is_varied(&self) -> bool {
        self.values.len() > 1
    }
}

/// The parts of a text between commas that stand in no bracket and in no quotes.
fn parts(text: &str) -> Vec<&str> {
    let (mut depth, mut is_quoted, mut is_escaped, mut start) = (0i32, false, false, 0);
    let mut out = Vec::new();
    for (at, c) in text.char_indices() {
        match c {
            _ if is_escaped => is_escaped = false,
            '\\' if is_quoted => is_escaped = true,
            '"' => is_quoted = !is_quoted,
            _ if is_quoted => {}
            '(' | '[' | '{' => depth += 1,
            ')' | ']' | '}' => depth -= 1,
            ',' if depth <= 0 => {
                out.push(&text[start..at]);
                start = at + 1;
            }
            _ => {}
        }
    }
    out.push(&text[start..]);
    out
}

/// The values of `a..b`, `a..bxstep` or `a..b/count`, ends included; `None` for what is no range.
fn range(text: &str) -> Option<Result<Vec<String>, String>> {
    let (first, rest) = text.split_once("..")?;
    let by = rest.find(['x', '/']);
    let last = by.map_or(rest, |at| &rest[..at]);
    let (a, b): (f64, f64) = (first.trim().parse().ok()?, last.trim().parse().ok()?);
    if !(a.is_finite() && b.is_finite()) {
        return None;
    }
    let is_whole = [first, last].iter().all(|n| n.trim().parse::<i64>().is_ok());
    let count = match by.map(|at| (rest.as_bytes()[at], rest[at + 1..].trim())) {
        Some((b'/', n)) => match n.parse::<usize>() {
            Ok(n) if (2..=MOST).contains(&n) => return Some(Ok(spread(a, b, n))),
            _ => return Some(Err(format!("expected 2 to {MOST} values in a range with `/`"))),
        },
        Some((_, step)) => step.parse::<f64>().ok().filter(|s| s.is_finite() && *s > 0.0),
        None => Some(1.0),
    };
    let Some(step) = count else { return Some(Err("expected a step above 0 behind `x`".to_owned())) };
    if a > b {
        return Some(Err("expected a range that goes up".to_owned()));
    }
    let n = ((b - a) / step + 1e-9).floor();
    if n >= MOST as f64 {
        return Some(Err(format!("expected at most {MOST} values in a range")));
    }
    let is_whole = is_whole && step.fract() == 0.0;
    Some(Ok((0..=n as usize).map(|i| written(a + i as f64 * step, is_whole)).collect()))
}

fn spread(a: f64, b: f64, n: usize) -> Vec<String> {
    let at = |i: usize| a + (b - a) * i as f64 / (n - 1) as f64;
    let is_whole = (0..n).all(|i| at(i).fract() == 0.0);
    (0..n).map(|i| written(at(i), is_whole)).collect()
}

/// A number to twelve figures behind the point; always with a point where others of its range have one, as inputs that take numbers may not take whole
/// ones in one place and others in the next.
fn written(value: f64, is_whole: bool) -> String {
    if is_whole {
        return format!("{value:.0}");
    }
    let text = format!("{value:.12}");
    let text = text.trim_end_matches('0');
    if text.ends_with('.') { format!("{text}0") } else { text.to_owned() }
}

/// Every combination of the axes' values, the last axis the quickest; or, where they are `zipped`, the first of each, the second of each, and so on.
pub(super) fn variants(axes: &[Axis], is_zipped: bool) -> Result<Vec<Variant>, String> {
    let varied: Vec<&Axis> = axes.iter().filter(|a| a.is_varied()).collect();
    let Some(first) = varied.first() else {
        return Err("expected several values in one --set or --var at least, as --set track.levels=1,2,4".to_owned());
    };
    let n = match is_zipped {
        true => match varied.iter().find(|a| a.values.len() != first.values.len()) {
            Some(other) => {
                let found = format!("{} of `{}` and {} of `{}`", first.values.len(), first.name, other.values.len(), other.name);
                return Err(format!("expected as many values of each with --zip, found {found}"));
            }
            None => first.values.len(),
        },
        false => varied.iter().fold(1usize, |n, a| n.saturating_mul(a.values.len())),
    };
    if n > MOST {
        return Err(format!("expected at most {MOST} variants, found {n}: give fewer values, or pair them with --zip"));
    }
    let mut out: Vec<Variant> = Vec::with_capacity(n);
    for i in 0..n {
        let picks = if is_zipped { axes.iter().map(|a| if a.is_varied() { i } else { 0 }).collect() } else { digits(axes, i) };
        let mut folder = folder(axes, &picks);
        if out.iter().any(|v| v.folder == folder) {
            folder = format!("{folder}~{}", i + 1);
        }
        out.push(Variant { picks, folder });
    }
    Ok(out)
}

/// The `i`th combination.
fn digits(axes: &[Axis], mut i: usize) -> Vec<usize> {
    let mut picks = vec![0; axes.len()];
    for (pick, axis) in picks.iter_mut().zip(axes).rev() {
        (*pick, i) = (i % axis.values.len(), i / axis.values.len());
    }
    picks
}

/// `track.levels=4, matte.close_gaps=2`: what sets a variant apart.
pub(super) fn label(axes: &[Axis], picks: &[usize]) -> String {
    let one = |(axis, pick): (&Axis, &usize)| format!("{}={}", axis.name, axis.values[*pick]);
    axes.iter().zip(picks).filter(|(a, _)| a.is_varied()).map(one).collect::<Vec<_>>().join(", ")
}

/// The label as a folder's name on any system.
fn folder(axes: &[Axis], picks: &[usize]) -> String {
    let plain = |c: char| if c.is_alphanumeric() || "._=,+-@#".contains(c) { c } else { '_' };
    let label: String = label(axes, picks).replace(", ", ",").chars().map(plain).take(120).collect();
    format!("wedge_{label}")
}

#[cfg(test)]
mod tests {
    use super::*;

    fn values(text: &str) -> Result<Vec<String>, String> {
        Axis::new("a.b", text, false).map(|a| a.values)
    }

    #[test]
    fn lists_and_ranges_are_read() {
        let fine = |text: &str| values(text).unwrap().join(" ");
        assert_eq!(fine("1,2,4"), "1 2 4");
        assert_eq!(fine("1..5x2"), "1 3 5");
        assert_eq!(fine("-1..1"), "-1 0 1");
        assert_eq!(fine("0..1/5"), "0.0 0.25 0.5 0.75 1.0");
        assert_eq!(fine("0..8/5"), "0 2 4 6 8");
        assert_eq!(fine("1..0/3"), "1.0 0.5 0.0", "a count may go down");
        assert_eq!(fine("0.1..0.3x0.1"), "0.1 0.2 0.3");
        assert_eq!(fine("0,2..3,cubic"), "0 2 3 cubic");
        assert_eq!(fine("(1, 2),(3, 4)"), "(1, 2) (3, 4)");
        assert_eq!(fine(r#""a,\"b",c"#), r#""a,\"b" c"#);
        assert_eq!(fine("../art/a.png,b"), "../art/a.png b");
    }

    #[test]
    fn what_is_no_range_is_said() {
        assert!(values("1,,2").unwrap_err().starts_with("expected values as a,b,c"));
        assert_eq!(values("1..5x0").unwrap_err(), "expected a step above 0 behind `x` for `a.b`, found `1..5x0`");
        assert!(values("5..1").unwrap_err().starts_with("expected a range that goes up"));
        assert!(values("0..1/1").unwrap_err().starts_with("expected 2 to 1000 values"));
        assert!(values("0..1e9").unwrap_err().starts_with("expected at most 1000 values"));
    }

    #[test]
    fn variants_are_a_product_or_pairs() {
        let axis = |name: &str, text: &str| Axis::new(name, text, false).unwrap();
        let axes = [axis("a.x", "1,2"), axis("a.fixed", "9"), axis("b.y", "1..3")];
        let product = variants(&axes, false).unwrap();
        assert_eq!(product.iter().map(|v| v.picks.clone()).collect::<Vec<_>>()[..4], [[0, 0, 0], [0, 0, 1], [0, 0, 2], [1, 0, 0]]);
        assert_eq!((product.len(), product[4].folder.as_str()), (6, "wedge_a.x=2,b.y=2"));
        assert!(variants(&axes, true).unwrap_err().ends_with("found 2 of `a.x` and 3 of `b.y`"));
        let pairs = variants(&[axis("a.x", "1,2"), axis("b.y", "/p/q,/p_q")], true).unwrap();
        assert_eq!(pairs.iter().map(|v| v.folder.as_str()).collect::<Vec<_>>(), ["wedge_a.x=1,b.y=_p_q", "wedge_a.x=2,b.y=_p_q"]);
        assert!(variants(&[axis("a.x", "1")], false).is_err());
        assert!(variants(&[axis("a.x", "1..999"), axis("a.y", "1..2")], false).unwrap_err().contains("found 1998"));
        let same = variants(&[axis("a.x", "a/b,a_b")], false).unwrap();
        assert_eq!(same[1].folder, "wedge_a.x=a_b~2");
    }
}
