//! Processors other than this one: code for AArch64, and for x86-64 processors of every
//! age. What it computes is tested where it runs: `conformance` has the x86-64 ones, and
//! `scripts/emulated` runs all tests on other processors.

use tamis_jit::{
    Body, Chains, CompileError, Compiler, CpuFeatures, CrossCompiler, Lanes, Side, Width,
    WindowSpec,
};

/// Every instruction once, for so many weights.
struct Everything(usize);

impl Body for Everything {
    fn emit<L: Lanes>(&self, lanes: &mut L) -> Vec<L::F> {
        let (x, y, z) = (lanes.plane(0, Side::I), lanes.plane(0, Side::J), lanes.tap(0));
        let x = lanes.fma(x, y, z);
        let (a, b) = (lanes.min(x, y), lanes.max(x, z));
        let mask = lanes.lt(a, b);
        let x = lanes.select(mask, x, a);
        let (x, y) = (lanes.neg(x), lanes.abs(b));
        let (x, y) = (lanes.add(x, y), lanes.sub(x, y));
        let (x, y) = (lanes.mul(x, y), lanes.div(x, y));
        let (x, y) = (lanes.sqrt(x), lanes.round(y));
        let (x, y) = (lanes.exponent(x), lanes.exp2i(y));
        let y = lanes.fraction(y);
        let one = lanes.constant(1.0);
        vec![lanes.fma(x, y, one); self.0]
    }
}

/// The sizes of kernels of every kind: with few sums, with more than fit into registers,
/// and mirrored.
fn sizes(triple: &str, flags: &[&str]) -> Vec<usize> {
    let compiler = CrossCompiler::new(triple, flags).expect("the tests build this target");
    let size = |weights: usize, mirrored: bool, chains| {
        let spec = WindowSpec {
            planes: 1,
            taps: 1,
            channels: 1,
            weights,
            absolute: true,
            lone: false,
            mirrored,
        };
        let body = Everything(if mirrored { 2 * weights } else { weights });
        let code = compiler.compile(spec, chains, &body);
        code.expect("the verifier has no objection, and nothing is called").len()
    };
    let kinds = [(1, false), (6, false), (3, true)];
    kinds.iter().flat_map(|&(n, mirrored)| Chains::ALL.map(|c| size(n, mirrored, c))).collect()
}

#[test]
fn aarch64_has_every_instruction() {
    let sizes = sizes("aarch64-unknown-linux-gnu", &[]);
    // An instruction has four bytes there, and every one of these kernels has dozens.
    assert!(sizes.iter().all(|size| *size > 200), "{sizes:?}");
}

#[test]
#[cfg(target_arch = "x86_64")]
fn x86_64_of_every_age_calls_nothing() {
    let sse41 = ["has_sse3", "has_ssse3", "has_sse41"];
    let avx = [&sse41[..], &["has_avx"]].concat();
    let fma = [&avx[..], &["has_fma"]].concat();
    let ages = [&[][..], &sse41, &avx, &fma].map(|flags| sizes("x86_64-unknown-linux-gnu", flags));
    // What is younger needs less code.
    for pair in ages.windows(2) {
        assert!(pair[0].iter().zip(&pair[1]).all(|(old, new)| old > new), "{ages:?}");
    }
    // The flags that `CpuFeatures` does not know make no difference.
    let rest = ["has_sse42", "has_popcnt", "has_lzcnt", "has_bmi1", "has_bmi2"];
    let wide = ["has_avx512f", "has_avx512dq", "has_avx512vl", "has_avx512vbmi"];
    let avx2 = [&fma[..], &["has_avx2"]].concat();
    let all = [&avx2[..], &rest, &wide].concat();
    let [avx2, all] = [avx2, all].map(|flags| sizes("x86_64-unknown-linux-gnu", &flags));
    assert_eq!(avx2, all);
}

#[test]
fn targets_that_there_are_not() {
    let unknown = CrossCompiler::new("sparc-unknown-linux-gnu", &[]);
    assert!(matches!(unknown, Err(CompileError::Host(why)) if why.contains("sparc")));
    let flag = CrossCompiler::new("aarch64-unknown-linux-gnu", &["has_avx"]);
    assert!(matches!(flag, Err(CompileError::Host(why)) if why.contains("aarch64")));
}

/// A panic of Cranelift's own, not of a body.
#[test]
fn a_panic_inside_cranelift_is_an_error() {
    let panicked = CrossCompiler::new("no triple", &[]);
    assert!(matches!(panicked, Err(CompileError::Panic(why)) if why.contains("triple")));
    assert!(CrossCompiler::new("aarch64-unknown-linux-gnu", &[]).is_ok());
}

#[test]
#[cfg(target_arch = "x86_64")]
fn what_is_lacking_is_emulated() {
    let emulated = |features| Compiler::with_features(features).expect("it needs less").emulated();
    let sse41 = CpuFeatures { sse41: true, ..CpuFeatures::default() };
    assert_eq!(emulated(CpuFeatures::default()), ["fused multiply-add", "rounding"]);
    // An encoding that AVX has and SSE has not is what fused instructions are in.
    let lesser = [sse41, CpuFeatures { avx: true, ..sse41 }, CpuFeatures { fma: true, ..sse41 }];
    for features in lesser.into_iter().filter(|f| f.and(CpuFeatures::of_host()) == *f) {
        assert_eq!(emulated(features), ["fused multiply-add"]);
    }
}

/// Asking for more than there is gets what there is.
#[test]
fn features_are_those_of_the_host_at_most() {
    let all = CpuFeatures { sse41: true, avx: true, avx2: true, fma: true, avx512f: true };
    let widest = |features| Compiler::with_features(features).expect("a host").width();
    assert_eq!(widest(all), CpuFeatures::of_host().widest());
    assert_eq!(widest(CpuFeatures::default()), Width::Bits128);
}
