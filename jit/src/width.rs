//! How wide machine code is, and how wide it can be on a host.

use std::fmt;

/// How many lanes an instruction has.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Width {
    /// Four lanes, through Cranelift, on every processor that it knows.
    Bits128,
    /// Eight lanes: AVX2 and FMA.
    Bits256,
    /// Sixteen lanes: AVX-512F.
    Bits512,
}

/// The instruction sets of an x86-64 processor that code generators ask for, beyond
/// SSE2, which each has. On other processors there are none of them.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct CpuFeatures {
    /// SSE4.1 and the two sets before it: rounding and selection in one instruction.
    pub sse41: bool,
    /// Vectors of floats with three operands.
    pub avx: bool,
    /// 256-bit vectors, integers included.
    pub avx2: bool,
    /// Fused multiply-add on 128 and 256 bits.
    pub fma: bool,
    /// 512-bit vectors.
    pub avx512f: bool,
}

impl CpuFeatures {
    /// What this processor and its operating system offer.
    pub fn of_host() -> Self {
        #[cfg(target_arch = "x86_64")]
        {
            Self {
                sse41: is_x86_feature_detected!("sse3")
                    && is_x86_feature_detected!("ssse3")
                    && is_x86_feature_detected!("sse4.1"),
                avx: is_x86_feature_detected!("avx"),
                avx2: is_x86_feature_detected!("avx2"),
                fma: is_x86_feature_detected!("fma"),
                avx512f: is_x86_feature_detected!("avx512f"),
            }
        }
        #[cfg(not(target_arch = "x86_64"))]
        {
            Self::default()
        }
    }

    /// What both have.
    #[must_use]
    pub fn and(self, other: Self) -> Self {
        Self {
            sse41: self.sse41 && other.sse41,
            avx: self.avx && other.avx,
            avx2: self.avx2 && other.avx2,
            fma: self.fma && other.fma,
            avx512f: self.avx512f && other.avx512f,
        }
    }

    /// What Cranelift calls those that its code for kernels can use.
    pub(crate) fn flags(self) -> impl Iterator<Item = &'static str> {
        let flags = [
            (self.sse41, "has_sse3"),
            (self.sse41, "has_ssse3"),
            (self.sse41, "has_sse41"),
            (self.avx, "has_avx"),
            (self.avx2, "has_avx2"),
            (self.fma, "has_fma"),
        ];
        flags.into_iter().filter_map(|(has, flag)| has.then_some(flag))
    }

    /// Whether code of this width runs. 128 bits do on every processor that Cranelift
    /// knows, with longer code where instructions are missing.
    pub fn allow(self, width: Width) -> bool {
        match width {
            Width::Bits128 => true,
            Width::Bits256 => self.avx2 && self.fma,
            Width::Bits512 => self.avx2 && self.fma && self.avx512f,
        }
    }

    /// The widest width that runs.
    pub fn widest(self) -> Width {
        let allowed = Width::ALL.into_iter().rev().find(|&width| self.allow(width));
        allowed.unwrap_or(Width::Bits128)
    }
}

impl Width {
    /// Every width, from the narrowest to the widest.
    pub const ALL: [Self; 3] = [Self::Bits128, Self::Bits256, Self::Bits512];

    /// Bits of a vector.
    pub fn bits(self) -> usize {
        self.bytes() * 8
    }

    /// Lanes of a vector.
    pub fn lanes(self) -> usize {
        self.bytes() / size_of::<f32>()
    }

    /// Bytes of a vector.
    pub(crate) fn bytes(self) -> usize {
        match self {
            Self::Bits128 => 16,
            Self::Bits256 => 32,
            Self::Bits512 => 64,
        }
    }

    /// The code generator that makes it.
    pub fn generator(self) -> &'static str {
        match self {
            Self::Bits128 => "Cranelift",
            Self::Bits256 | Self::Bits512 => "Tamis",
        }
    }

    /// The instruction sets that it takes, for messages.
    pub fn needs(self) -> &'static str {
        match self {
            Self::Bits128 => "any x86-64 or AArch64",
            Self::Bits256 => "AVX2 and FMA",
            Self::Bits512 => "AVX-512F",
        }
    }
}

impl fmt::Display for Width {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} bits", self.bits())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_choice_follows_the_features() {
        let all = CpuFeatures { sse41: true, avx: true, avx2: true, fma: true, avx512f: true };
        assert_eq!(all.widest(), Width::Bits512);
        assert_eq!(CpuFeatures { avx512f: false, ..all }.widest(), Width::Bits256);
        assert_eq!(CpuFeatures { avx2: false, ..all }.widest(), Width::Bits128);
        assert_eq!(CpuFeatures { fma: false, ..all }.widest(), Width::Bits128);
        assert_eq!(CpuFeatures::default().widest(), Width::Bits128);
        assert_eq!(all.and(CpuFeatures::default()), CpuFeatures::default());
        assert_eq!(all.and(all), all);
    }
}
