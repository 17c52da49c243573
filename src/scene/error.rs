//! What can go wrong with scenes, beyond what can with the files that they are in.

use std::path::PathBuf;

use crate::image::ImageError;
use crate::image::exr::Window;

/// Why a scene could not be read or used.
#[derive(Debug, thiserror::Error)]
pub enum SceneError {
    /// Its file could not be read.
    #[error(transparent)]
    Image(#[from] ImageError),
    /// No convention recognises a colour.
    #[error(
        "{path}: no colour found: there are no channels R, G and B, and no layer is called as \
         renderers call their picture. Choose one with `--map color=NAME`; the file has {present}",
        path = path.display()
    )]
    MissingColor {
        /// The file.
        path: PathBuf,
        /// The layers of three channels that the file has, or its channels, as text.
        present: String,
    },
    /// The colour is stored as luminance and chroma.
    #[error(
        "{path}: its colour is stored as luminance and chroma (Y, RY and BY), which is not read: \
         taken for grey, it would lose its colours. Save it as R, G and B, which renderers and \
         OpenEXR's own tools do",
        path = path.display()
    )]
    LuminanceChroma {
        /// The file.
        path: PathBuf,
    },
    /// A view, a layer or a channel that was asked for is not there.
    #[error("{path}: there is no {what} \"{name}\" in it; there is: {present}", path = path.display())]
    NotInFile {
        /// The file.
        path: PathBuf,
        /// What was asked for: a view or a layer.
        what: &'static str,
        /// Its name.
        name: String,
        /// What there is, as text.
        present: String,
    },
    /// A file beside the colour's has nothing in it that is known.
    #[error(
        "{path}: nothing in it is known to be a feature; say what it is: `--albedo`, `--normal` \
         or `--depth` in place of `--aux`, or `--map`", path = path.display()
    )]
    FeedsNothing {
        /// The file.
        path: PathBuf,
    },
    /// A file beside the colour's is of another picture: its pixels are elsewhere, and no
    /// common frame says where.
    #[error(
        "{path}: {feature} of {window} pixels do not fit the colour in {color}, which has \
         {color_window}; give a file of the same size, or, for a part of the picture, an OpenEXR \
         file that has the colour's display window",
        path = path.display(), color = color.display()
    )]
    OtherSize {
        /// The file.
        path: PathBuf,
        /// What is taken from it.
        feature: &'static str,
        /// Where its pixels are.
        window: Window,
        /// The colour's file.
        color: PathBuf,
        /// Where the colour's pixels are.
        color_window: Window,
    },
    /// A filter reads a feature that the file does not hold.
    #[error(
        "{path}: the filter reads `{term}`, which this file does not provide; \
         looked for {looked_for}; the file has {present}. \
         {setting}, or use a filter that does not read it",
        path = path.display()
    )]
    MissingFeature {
        /// The file.
        path: PathBuf,
        /// The field's term, as expressions spell it, `--map` takes it and `inspect` lists it.
        term: String,
        /// The channels that would have been taken.
        looked_for: String,
        /// What the file has, as text.
        present: String,
        /// What to do to have it in the file: what to switch on, as its renderer calls it, if
        /// the renderer is known.
        setting: String,
    },
    /// A filter reads a feature that a frame in memory does not have.
    #[error(
        "{scene}: the filter reads `{term}`, which is not there; give it, or use a filter that does not read it"
    )]
    NotGiven {
        /// What reports call the frame.
        scene: String,
        /// The field's term, as expressions spell it.
        term: String,
    },
    /// Pixels that are no numbers, and the user asked to refuse them.
    #[error(
        "{path}: channel \"{channel}\" has {count} pixel(s) that are not finite or beyond \
         ±1e18, the first at x = {}, y = {}; repair them with `--repair median`",
        first.0, first.1, path = path.display()
    )]
    BadPixels {
        /// The file.
        path: PathBuf,
        /// The channel's full name.
        channel: String,
        /// How many.
        count: usize,
        /// Where the first one is.
        first: (usize, usize),
    },
    /// A folder that is not a scene.
    #[error(
        "{path}: not a scene folder: there is no {missing} in it \
         (a scene is a folder with 4spp.exr and reference.exr)",
        path = path.display()
    )]
    NotAScene {
        /// The folder.
        path: PathBuf,
        /// The file that should be there.
        missing: &'static str,
    },
    /// No scene below the folders given.
    #[error("no scenes found below {folders}; a scene is a folder with 4spp.exr and reference.exr")]
    NoScenes {
        /// The folders searched, as text.
        folders: String,
    },
}
