//! The languages, as the command line and tests know them: one row each.

/// What a filter can be exported as.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum Language {
    /// C99.
    C,
    /// LaTeX with amsmath.
    Latex,
    /// Python with NumPy.
    Python,
    /// One that GPUs are programmed in.
    Shading(Shading),
}

/// A shading language. Only what is built with the feature `gpu` writes them.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum Shading {
    /// WebGPU's.
    Wgsl,
    /// Vulkan's and OpenGL's, version 4.50.
    Glsl,
    /// Direct3D's, shader model 6.0.
    Hlsl,
    /// Metal's, version 2.1.
    Msl,
    /// What Vulkan runs, version 1.3, in binary.
    Spirv,
}

struct Row {
    name: &'static str,
    ending: &'static str,
    doc: &'static str,
}

impl Language {
    /// Every language.
    pub const ALL: [Self; 8] = [
        Self::C,
        Self::Latex,
        Self::Python,
        Self::Shading(Shading::Wgsl),
        Self::Shading(Shading::Glsl),
        Self::Shading(Shading::Hlsl),
        Self::Shading(Shading::Msl),
        Self::Shading(Shading::Spirv),
    ];

    /// What the command line calls it.
    pub fn name(self) -> &'static str {
        self.row().name
    }

    /// The usual ending of its files' names.
    pub fn ending(self) -> &'static str {
        self.row().ending
    }

    /// One line for people.
    pub fn doc(self) -> &'static str {
        self.row().doc
    }

    /// The language of a name.
    pub fn named(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|language| language.name() == name)
    }

    /// Whether exports in it are no text.
    pub fn is_binary(self) -> bool {
        self == Self::Shading(Shading::Spirv)
    }

    fn row(self) -> Row {
        match self {
            Self::C => Row {
                name: "c",
                ending: "c",
                doc: "C99: all that a filter computes, the interpreter's bits",
            },
            Self::Latex => Row {
                name: "latex",
                ending: "tex",
                doc: "LaTeX with amsmath: the filter as equations",
            },
            Self::Python => Row {
                name: "python",
                ending: "py",
                doc: "Python with NumPy: a function per stage, in double precision",
            },
            Self::Shading(Shading::Wgsl) => Row {
                name: "wgsl",
                ending: "wgsl",
                doc: "WGSL: weight function and compute kernel for WebGPU",
            },
            Self::Shading(Shading::Glsl) => Row {
                name: "glsl",
                ending: "comp",
                doc: "GLSL 4.50: the same kernel for Vulkan or OpenGL",
            },
            Self::Shading(Shading::Hlsl) => Row {
                name: "hlsl",
                ending: "hlsl",
                doc: "HLSL, shader model 6.0: the same kernel for Direct3D 12",
            },
            Self::Shading(Shading::Msl) => Row {
                name: "msl",
                ending: "metal",
                doc: "Metal shading language 2.1: the same kernel",
            },
            Self::Shading(Shading::Spirv) => Row {
                name: "spirv",
                ending: "spv",
                doc: "SPIR-V 1.3, binary: the same kernel for Vulkan 1.1",
            },
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn languages_have_names_of_their_own() {
        for language in Language::ALL {
            assert_eq!(Language::named(language.name()), Some(language));
        }
        assert_eq!(Language::named("fortran"), None);
    }
}
