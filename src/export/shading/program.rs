//! The kernels of a program, a file each, and a manifest: what to bind and to dispatch.
//!
//! They are the kernels that the GPU back end runs. All have the same buffers; what these hold
//! and how long they are stands in the manifest, which is read off the shaders wherever they
//! say it.

use naga::{AddressSpace, TypeInner};
use serde_json::{Value, json};

use super::valid::{Access, Valid};
use super::{glsl, hlsl, msl, spirv};
use crate::backend::shader::program::{KernelShader, ProgramShader, WORKGROUP};
use crate::backend::shader::wgsl::{Arithmetic, Dialect};
use crate::export::program::ProgramSubject;
use crate::export::term::Term;
use crate::export::{Language, Shading, header};
use crate::expr::feature::PlaneId;
use crate::filter::Grid;
use crate::plan::Precision;

/// The file that says how the others are used.
const MANIFEST: &str = "manifest.json";

/// The files by name; or else naga's complaint.
pub(crate) fn files(
    subject: &ProgramSubject<'_>,
    language: Shading,
    precision: Precision,
) -> Result<Vec<(String, Vec<u8>)>, String> {
    let dialect = Dialect { precision, arithmetic: Arithmetic::IEEE };
    let shader = ProgramShader::new(&subject.program, dialect);
    let ending = Language::Shading(language).ending();
    let mut files = Vec::new();
    let mut kernels = Vec::new();
    let mut buffers = Value::Null;
    let count = shader.kernels.len();
    for (k, kernel) in shader.kernels.iter().enumerate() {
        let comment = format!(
            "// Kernel {} of {count} of filter {:?}, exported by Tamis: see {MANIFEST}.\n",
            k + 1,
            subject.name
        );
        let valid = Valid::new(comment.clone() + &shader.module(kernel))?;
        let (bytes, entry) = written(&valid, language, &comment)?;
        let name = format!("{k:03}_{}.{ending}", kernel.name);
        kernels.push(described(kernel, &name, &entry));
        files.push((name, bytes));
        if buffers.is_null() {
            buffers = bindings(&valid, &shader, language);
        }
    }
    let constants = &subject.program.filter.constants.params;
    let constants: serde_json::Map<String, Value> =
        constants.iter().map(|param| (param.name.clone(), json!(param.value))).collect();
    let called = |term: Term| {
        let planes = PlaneId::of(term.feature, term.quantity).map(PlaneId::identifier);
        planes.collect::<Vec<_>>().join(", ")
    };
    let manifest = json!({
        "filter": subject.name,
        "program": concat!("tamis ", env!("CARGO_PKG_VERSION")),
        "language": Language::Shading(language).name(),
        "precision": precision.name(),
        "about": header::program_lines(subject, called),
        "use": USE,
        "halo": shader.halo,
        "buffers": buffers,
        "kernels": kernels,
        "taps": shader.taps,
        "constants": constants,
    });
    let text = serde_json::to_string_pretty(&manifest).map_err(|error| error.to_string())?;
    files.push((MANIFEST.to_owned(), (text + "\n").into_bytes()));
    Ok(files)
}

/// What a caller does, whatever the language.
const USE: &str = "width and height are the size of the region that `features` holds: the image, or \
     a part of it that reaches `halo` pixels beyond what is wanted, where the image goes on, and \
     begins at an even column and row. Set `kept` to 0, then run the kernels in their order, each \
     after the writes of those before it, with the same buffers. The `constants` are in the code, \
     and so are layers; `taps` is the content of the buffer of that name.";

/// A kernel in a language, and what its entry point is called there.
fn written(valid: &Valid, language: Shading, comment: &str) -> Result<(Vec<u8>, String), String> {
    let (_, entry) = valid.entry_point();
    Ok(match language {
        Shading::Wgsl => (valid.text().as_bytes().to_vec(), entry),
        Shading::Glsl => {
            let text = glsl::text(valid)?;
            let (version, rest) = text.split_once('\n').expect("the version is a line");
            (format!("{version}\n{comment}{rest}").into_bytes(), "main".to_owned())
        }
        Shading::Hlsl => {
            let (text, entry) = hlsl::text(valid)?;
            (format!("{comment}{text}").into_bytes(), entry)
        }
        Shading::Msl => {
            let (text, entry) = msl::text(valid)?;
            (format!("{comment}{text}").into_bytes(), entry)
        }
        Shading::Spirv => (spirv::bytes(valid)?, entry),
    })
}

/// A kernel's part of the manifest.
fn described(kernel: &KernelShader, file: &str, entry: &str) -> Value {
    let [columns, rows] = WORKGROUP;
    let [width, height] = match kernel.grid {
        Some(Grid::Full) => ["width", "height"],
        Some(Grid::Half) => ["half_width", "half_height"],
        None => ["wanted_width", "wanted_height"],
    };
    json!({
        "file": file,
        "entry": entry,
        "workgroup": [columns, rows, 1],
        "dispatch": [
            format!("ceil({width} / {columns})"),
            format!("ceil({height} / {rows})"),
            "1",
        ],
    })
}

/// The buffers, in the order of their bindings.
fn bindings(valid: &Valid, shader: &ProgramShader, language: Shading) -> Value {
    let buffers = valid.buffers().into_iter().map(|buffer| {
        let (access, register) = match buffer.access {
            Access::Uniform => ("uniform", 'b'),
            Access::Read => ("read-only storage", 't'),
            Access::Write => ("storage", 'u'),
        };
        let (format, length, doc) = contents(shader, &buffer.name);
        let mut described = json!({
            "name": buffer.name,
            "group": buffer.binding.group,
            "binding": buffer.binding.binding,
            "access": access,
            "format": format,
            "length": length,
            "holds": doc,
        });
        if language == Shading::Hlsl {
            described["register"] = json!(format!("{register}{}", buffer.binding.binding));
        }
        if buffer.access == Access::Uniform {
            described["fields"] = fields(valid);
        }
        described
    });
    buffers.collect()
}

/// What a buffer's numbers are, how many there are, and what they mean.
fn contents(shader: &ProgramShader, name: &str) -> (&'static str, String, Value) {
    let ProgramShader { full, half, .. } = shader;
    match name {
        "features" => {
            let planes: Vec<String> =
                shader.features.iter().map(|plane| plane.identifier()).collect();
            ("f32", format!("{} * width * height", planes.len()), json!(planes))
        }
        "taps" => ("f32", shader.taps.len().to_string(), json!("the numbers of `taps` below")),
        "planes" => (
            "f32",
            format!("{full} * width * height + {half} * half_width * half_height"),
            json!("what kernels leave to later ones; half_width is ceil(width / 2)"),
        ),
        "kept" => (
            "u32",
            shader.stages.to_string(),
            json!("by stage, how many wanted pixels kept what was to be averaged; 0 before"),
        ),
        "result" => (
            "vec4<f32>",
            "wanted_width * wanted_height".to_owned(),
            json!("filtered red, green, blue and 0, row by row"),
        ),
        _ => ("struct", "1".to_owned(), json!("see `fields`")),
    }
}

/// The fields of the uniforms, with their places in bytes.
fn fields(valid: &Valid) -> Value {
    let module = valid.module();
    let uniform = module.global_variables.iter().find(|(_, v)| v.space == AddressSpace::Uniform);
    let Some((_, variable)) = uniform else { return Value::Null };
    let TypeInner::Struct { members, .. } = &module.types[variable.ty].inner else {
        return Value::Null;
    };
    let field = |member: &naga::StructMember| {
        let name = member.name.as_deref().unwrap_or_default();
        let (kind, doc) = match name {
            "size" => ("vec2<i32>", "width, height"),
            "half_size" => {
                ("vec2<i32>", "half_width, half_height: ceil(width / 2), ceil(height / 2)")
            }
            "corner" => ("vec2<i32>", "column and row of the image where the region begins; even"),
            "origin" => ("vec2<i32>", "column and row of the region of the first wanted pixel"),
            "wanted" => ("vec2<i32>", "wanted_width, wanted_height: how many pixels are wanted"),
            "exposure" => ("f32", "the filtered colours are multiplied by it"),
            _ => ("u32", "0, which the compiler must not know"),
        };
        json!({ "name": name, "type": kind, "offset": member.offset, "holds": doc })
    };
    members.iter().map(field).collect()
}
