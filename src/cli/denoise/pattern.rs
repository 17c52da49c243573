//! Names of many frames at once, `shot.####.exr` and `shot.%04d.exr`, and the number in
//! the name of one.

use std::ops::Range;
use std::path::{Path, PathBuf};

/// A path whose name has a place for the frame's number.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Pattern {
    folder: PathBuf,
    before: String,
    /// Digits of the number at least; shorter ones begin with zeros.
    width: usize,
    after: String,
}

impl Pattern {
    /// The pattern that a path is, if it is one. A place for the number is looked for in
    /// the name alone, not in the folders; of several `#` runs, the last one counts.
    pub(super) fn of(path: &Path) -> Option<Self> {
        let name = path.file_name()?.to_str()?;
        let (place, width) = hashes(name).or_else(|| percent(name))?;
        Some(Self {
            folder: path.parent().unwrap_or(Path::new("")).to_owned(),
            before: name[..place.start].to_owned(),
            width,
            after: name[place.end..].to_owned(),
        })
    }

    /// The pattern of a numbered file's fellows: its last number is their place.
    pub(super) fn around(path: &Path) -> Option<Self> {
        let name = path.file_name()?.to_str()?;
        let place = last_digits(path, name)?;
        Some(Self {
            folder: path.parent().unwrap_or(Path::new("")).to_owned(),
            before: name[..place.start].to_owned(),
            width: place.len(),
            after: name[place.end..].to_owned(),
        })
    }

    /// Where its files are.
    pub(super) fn folder(&self) -> &Path {
        match self.folder.as_os_str().is_empty() {
            true => Path::new("."),
            false => &self.folder,
        }
    }

    /// The path of a frame.
    pub(super) fn path(&self, number: u64) -> PathBuf {
        let Self { folder, before, width, after } = self;
        folder.join(format!("{before}{number:0width$}{after}"))
    }

    /// The number in a file's name, if the name is one of the pattern's.
    pub(super) fn number(&self, name: &str) -> Option<u64> {
        let digits = name.strip_prefix(&self.before)?.strip_suffix(&self.after)?;
        let number = digits_as_number(digits)?;
        // `shot.007.exr` is no `shot.##.exr`: this program would call it `shot.07.exr`.
        (format!("{number:0width$}", width = self.width) == digits).then_some(number)
    }
}

/// The last number in a file's name, its ending left out.
pub(super) fn last_number(path: &Path) -> Option<u64> {
    let name = path.file_name()?.to_str()?;
    digits_as_number(&name[last_digits(path, name)?])
}

/// Where the last digits of a name are. Those of an ending (`.jp2`) are no number.
fn last_digits(path: &Path, name: &str) -> Option<Range<usize>> {
    let stem = path.file_stem()?.to_str()?;
    let is_digit = |c: char| c.is_ascii_digit();
    let end = stem.rfind(is_digit)? + 1;
    let start = stem[..end].rfind(|c| !is_digit(c)).map_or(0, |at| {
        at + stem[at..].chars().next().expect("something was found there").len_utf8()
    });
    debug_assert!(name.starts_with(stem));
    Some(start..end)
}

/// The last run of `#`, a digit each.
fn hashes(name: &str) -> Option<(Range<usize>, usize)> {
    let end = name.rfind('#')? + 1;
    let start = name[..end].trim_end_matches('#').len();
    Some((start..end, end - start))
}

/// `%04d`, or `%d`, as C's `printf` has it.
fn percent(name: &str) -> Option<(Range<usize>, usize)> {
    name.match_indices('%').find_map(|(start, _)| {
        let (width, _) = name[start + 1..].split_once('d')?;
        let digits = match width {
            "" => 1,
            _ if width.starts_with('0') => digits_as_number(width)?.max(1),
            _ => return None,
        };
        // Names are shorter than that.
        let digits = usize::try_from(digits).ok().filter(|&digits| digits < 64)?;
        Some((start..start + 1 + width.len() + 1, digits))
    })
}

fn digits_as_number(digits: &str) -> Option<u64> {
    digits.bytes().all(|byte| byte.is_ascii_digit()).then(|| digits.parse().ok())?
}

#[cfg(test)]
mod tests {
    use super::*;

    fn pattern(text: &str) -> Pattern {
        Pattern::of(Path::new(text)).expect("a pattern")
    }

    #[test]
    fn patterns_make_the_names_that_they_know() {
        for (text, number, path) in [
            ("in/shot.####.exr", 7, "in/shot.0007.exr"),
            ("in/shot.%04d.exr", 7, "in/shot.0007.exr"),
            ("shot.####.exr", 12_345, "shot.12345.exr"),
            ("shot_%d.exr", 42, "shot_42.exr"),
            ("take#1_##.exr", 3, "take#1_03.exr"),
            ("100%_%03d.exr", 3, "100%_003.exr"),
        ] {
            let pattern = pattern(text);
            assert_eq!(pattern.path(number), Path::new(path), "{text}");
            let name = Path::new(path).file_name().and_then(|name| name.to_str());
            assert_eq!(pattern.number(name.expect("a name")), Some(number), "{text}");
        }
        for name in ["shot.007.exr", "shot.00007.exr", "shot.+007.exr", "shot..exr", "shot.exr"] {
            assert_eq!(pattern("shot.####.exr").number(name), None, "{name}");
        }
        for text in ["shot.exr", "a#b/shot.exr", "100%.exr", "a%4d.exr", "a%0xd.exr", ".."] {
            assert_eq!(Pattern::of(Path::new(text)), None, "{text}");
        }
    }

    #[test]
    fn the_last_number_of_a_name_is_the_frames() {
        for (path, number) in [
            ("v2/shot_v003.0017.exr", Some(17)),
            ("0017.exr", Some(17)),
            ("é7é.exr", Some(7)),
            ("shot.exr", None),
            ("v2/shot", None),
            ("a.99999999999999999999999.exr", None),
        ] {
            assert_eq!(last_number(Path::new(path)), number, "{path}");
        }
        let fellows = Pattern::around(Path::new("v2/shot_v003.0017.exr")).expect("a number");
        assert_eq!(fellows.path(8), Path::new("v2/shot_v003.0008.exr"));
    }
}
