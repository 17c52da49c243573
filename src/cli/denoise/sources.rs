//! Which channels of which files feed a filter, where names do not tell.

use std::ffi::OsStr;
use std::path::{Path, PathBuf};

use clap::Args;

use super::files::Frame;
use super::pattern::Pattern;
use crate::cli::error::Error;
use crate::expr::Feature;
use crate::scene::listing::Aux;
use crate::scene::mapping::{Said, Selection};

/// Where features come from.
#[derive(Debug, Args)]
#[command(next_help_heading = "Channels and files")]
pub(super) struct Sources {
    /// What feeds a feature, where the layer's name does not tell: albedo=DiffuseFilter
    /// (again, or with commas, for more). Features: color, albedo, normal, depth, position,
    /// direct, secondaryAlbedo; variance is the color's, albedo.variance another's
    #[arg(long, value_name = "FEATURE=LAYER", value_delimiter = ',', value_parser = Said::read)]
    map: Vec<Said>,

    /// A file with the albedo in it: EXR, PFM, TIFF or PNG; of a sequence a pattern
    #[arg(long, value_name = "FILE")]
    albedo: Option<PathBuf>,

    /// A file with the normals in it
    #[arg(long, value_name = "FILE")]
    normal: Option<PathBuf>,

    /// A file with the depth in it
    #[arg(long, value_name = "FILE")]
    depth: Option<PathBuf>,

    /// Another file with features in it, whose names or whose channels' names tell which
    /// (again for more)
    #[arg(long, value_name = "FILE")]
    aux: Vec<PathBuf>,

    /// Filter further colour layers of the file by the colour's weights: 'light_*' (again, or
    /// with commas, for more); layers that add up to the colour still do
    #[arg(long, value_name = "PATTERN", value_delimiter = ',', value_parser = pattern)]
    pub(super) layers: Vec<glob::Pattern>,

    /// This view of a stereo image alone [default: every view, each with its own features]
    #[arg(long, value_name = "NAME")]
    view: Option<String>,

    /// This layer alone, of several that are pictures of their own (Blender's view layers)
    /// [default: every one]
    #[arg(long, value_name = "NAME")]
    layer: Option<String>,
}

impl Sources {
    /// What is selected of each frame.
    pub(super) fn selection(&self) -> Selection {
        Selection {
            view: self.view.clone(),
            layer: self.layer.clone(),
            said: self.map.clone(),
            samples: None,
        }
    }

    /// The files and patterns with features of their own, each with what it is said to hold.
    fn beside(&self) -> impl Iterator<Item = (&PathBuf, Option<Feature>)> {
        let said = [
            (&self.albedo, Feature::Texture),
            (&self.normal, Feature::Normal),
            (&self.depth, Feature::Depth),
        ];
        let said =
            said.into_iter().filter_map(|(path, feature)| Some((path.as_ref()?, Some(feature))));
        said.chain(self.aux.iter().map(|path| (path, None)))
    }

    /// Whether a file is one of those beside the frames' own, of whatever frame.
    pub(super) fn is_beside(&self, path: &Path) -> bool {
        let folder = |path: &Path| {
            let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty());
            folder.unwrap_or(Path::new(".")).canonicalize().ok()
        };
        let name = path.file_name().and_then(OsStr::to_str);
        self.beside().any(|(beside, _)| {
            let is_named = match Pattern::of(beside).filter(|_| !beside.exists()) {
                Some(pattern) => name.is_some_and(|name| pattern.number(name).is_some()),
                None => path.file_name() == beside.file_name(),
            };
            is_named && folder(path).is_some_and(|own| Some(own) == folder(beside))
        })
    }

    /// The files beside a frame's own: a pattern stands for that of the frame's number.
    pub(super) fn aux(&self, frame: &Frame) -> Result<Vec<Aux>, Error> {
        let file = |(path, feature): (&PathBuf, Option<Feature>)| {
            let path = match (Pattern::of(path).filter(|_| !path.exists()), frame.number) {
                (None, _) => path.clone(),
                (Some(pattern), Some(number)) => pattern.path(number),
                (Some(_), None) => {
                    return Err(Error::Usage(format!(
                        "{}: it has a place for the frame's number, and {} has no number; name \
                         its file, or leave out that frame",
                        path.display(),
                        frame.input_name(),
                    )));
                }
            };
            Ok(Aux { path, feature })
        };
        self.beside().map(file).collect()
    }
}

/// Reads a pattern of names.
fn pattern(text: &str) -> Result<glob::Pattern, String> {
    glob::Pattern::new(text).map_err(|error| error.to_string())
}
