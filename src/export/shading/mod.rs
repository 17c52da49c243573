//! Shading languages: the kernel that the GPU back end runs, in each of them.
//!
//! It is written as WGSL by `backend::shader`, validated, and brought into the
//! other languages by naga. Two things differ from what the back end runs: what
//! depends on the offset alone is computed for every pair, so that nobody has to
//! supply a table of it; and nothing is known of the device, so that exact code
//! assumes what IEEE 754 says.
//!
//! A program is many kernels: [`program`] writes them as files, with a manifest.
//!
//! Naga keeps names but drops comments. What a caller must know is therefore
//! said by [`comment`] in the first lines, in every language alike, and refers to
//! buffers by their binding: that number is the same in all languages.

mod comment;
mod glsl;
mod hlsl;
mod msl;
pub(super) mod program;
mod spirv;
mod valid;

use super::{Shading, Subject};
use crate::backend::shader::wgsl::{Arithmetic, Dialect};
use crate::backend::shader::{Loads, Shader, Style};
use crate::plan::Precision;
use comment::Caller;
use valid::Valid;

/// The kernel in a language; or else naga's complaint.
pub(super) fn bytes(
    subject: &Subject<'_>,
    language: Shading,
    precision: Precision,
) -> Result<Vec<u8>, String> {
    let dialect = Dialect { precision, arithmetic: Arithmetic::IEEE };
    let loads = Loads::Packed;
    let shader = Shader::new(&subject.plan, Style { dialect, loads, tap_table: false });
    let valid = Valid::new(shader.text.clone())?;
    let caller =
        Caller { subject, shader: &shader, valid: &valid, workgroup: loads.workgroup(), precision };
    let text = match language {
        Shading::Wgsl => caller.comment(language, "main") + valid.text(),
        Shading::Glsl => {
            let text = glsl::text(&valid)?;
            let (version, rest) = text.split_once('\n').expect("the version is a line");
            format!("{version}\n{}\n{rest}", caller.comment(language, "main"))
        }
        Shading::Hlsl => {
            let (text, entry_point) = hlsl::text(&valid)?;
            format!("{}\n{text}", caller.comment(language, &entry_point))
        }
        Shading::Msl => {
            let (text, entry_point) = msl::text(&valid)?;
            format!("{}\n{text}", caller.comment(language, &entry_point))
        }
        Shading::Spirv => {
            let documented = Valid::new(caller.comment(language, "main") + valid.text())?;
            return spirv::bytes(&documented);
        }
    };
    Ok(text.into_bytes())
}
