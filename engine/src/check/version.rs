//! Semantic versions of graphs that others use.
//!
//! A graph says its version (`version: "1.4.0"`), and whoever uses it may say which one it was written for: `type: "graph:capture/contour.ron@1.2"`.
//! A higher first number is another interface: the graph may have lost parameters or outputs, or ask for new ones. Below 1.0 the second number
//! is what the first is above it.

/// A graph's path, and the version behind its last `@`.
pub fn split(path: &str) -> (&str, Option<&str>) {
    match path.rsplit_once('@') {
        Some((path, version)) if parse(version).is_some() => (path, Some(version)),
        _ => (path, None),
    }
}

/// One to three numbers with dots between; what is left out is 0.
pub fn parse(text: &str) -> Option<[u32; 3]> {
    let mut out = [0; 3];
    let mut parts = text.split('.');
    for number in &mut out {
        let Some(part) = parts.next() else { break };
        let is_number = !part.is_empty() && part.bytes().all(|b| b.is_ascii_digit());
        *number = if is_number { part.parse().ok()? } else { return None };
    }
    (parts.next().is_none() && !text.is_empty()).then_some(out)
}

/// The part of a version that names the interface.
pub fn interface([major, minor, _]: [u32; 3]) -> [u32; 2] {
    if major == 0 { [0, minor] } else { [major, 0] }
}

/// Whether a graph of the version `found` serves who asks for `wanted`; what is wrong, and what to do, where it does not.
///
/// # Errors
/// Where it has no version, another interface, or is older.
pub fn serves(wanted: &str, found: Option<&str>) -> Result<(), (String, String)> {
    let Some(text) = found else {
        let whole = parse(wanted).unwrap_or_default().map(|n| n.to_string()).join(".");
        let help = format!("write `version: \"{whole}\"` in it, if that is what it is, or leave `@{wanted}` out");
        return Err((format!("expected version {wanted} of a graph, found one that says none"), help));
    };
    let (Some(want), Some(has)) = (parse(wanted), parse(text)) else {
        return Err((format!("expected a version as \"1.2.0\", found \"{text}\""), "a version is three whole numbers".to_owned()));
    };
    if interface(want) != interface(has) {
        let help = format!("its interface changed: `pegbar diff` of both says how; then ask for `@{}`", text.trim_end_matches(".0"));
        return Err((format!("expected version {wanted} of a graph, found {text}"), help));
    }
    if has < want {
        return Err((format!("expected version {wanted} of a graph or a later one, found {text}"), "update the graph".to_owned()));
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_version_serves_who_asks_for_it_or_for_less() {
        for (wanted, found) in [("1", "1.0.0"), ("1", "1.9.3"), ("1.2", "1.2.0"), ("0.3", "0.3.7"), ("2.0.1", "2.0.1")] {
            assert_eq!(serves(wanted, Some(found)), Ok(()), "{wanted} {found}");
        }
        for (wanted, found) in [("1", "2.0.0"), ("1.2", "1.1.9"), ("0.3", "0.4.0"), ("1", "0.9.0"), ("1", "one"), ("2.0.1", "2.0.0")] {
            assert!(serves(wanted, Some(found)).is_err(), "{wanted} {found}");
        }
        assert!(serves("1", None).is_err());
    }

    #[test]
    fn what_is_no_version_is_a_part_of_the_path() {
        assert_eq!(split("a@b/c.ron"), ("a@b/c.ron", None));
        assert_eq!(split("a@b/c.ron@1.2"), ("a@b/c.ron", Some("1.2")));
        assert_eq!(split("c.ron@"), ("c.ron@", None));
    }
}
