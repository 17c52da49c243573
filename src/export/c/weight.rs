//! The weight function: one statement per value of the tape.

use std::fmt::Write;

use super::{Source, list};
use crate::export::Subject;
use crate::export::term::Term;
use crate::expr::tape::{Axis, EXP2I_MAGIC, Input, Instr, Prim, ROOTS, Side, Value};

/// Columns that a function's head may take.
const LINE: usize = 80;

impl Source<'_> {
    /// The functions of bits that are called.
    pub(super) fn bit_tricks(&self) -> impl Iterator<Item = &'static (Prim, &'static str)> {
        BIT_TRICKS.iter().filter(|(prim, _)| {
            self.tape.instrs().iter().any(|instr| matches!(instr, Instr::Prim(p, _) if p == prim))
        })
    }

    /// The weight function: one statement per value of the tape.
    pub(super) fn weight(&self) -> String {
        let name = self.name;
        let pixels = ["i", "j"].map(|side| format!("const struct {name}_features *{side}"));
        let parameters = [
            (self.reads_i, pixels[0].as_str()),
            (self.reads_j, pixels[1].as_str()),
            (self.reads_dx, "float dx"),
            (self.reads_dy, "float dy"),
        ];
        let parameters = match list(parameters) {
            nothing if nothing.is_empty() => "void".to_owned(),
            parameters => parameters,
        };
        let offsets = match (self.reads_dx, self.reads_dy) {
            (false, false) => "",
            (true, _) | (_, true) => {
                ";\n   dx and dy lead from i to j, in pixels to the right and down"
            }
        };
        let mut signature = format!("static float {name}_weight({parameters})");
        if signature.len() > LINE {
            let lines = parameters.replace(", ", ",\n    ");
            signature = format!("static float {name}_weight(\n    {lines})");
        }
        let mut text = format!(
            "\n/* The weight of pixel j in the filtered colour of pixel i{offsets}. */\n\
             {signature}\n{{\n"
        );
        // Constants and inputs stand where they are used.
        let mut names: Vec<String> = Vec::with_capacity(self.tape.instrs().len());
        let mut statements = 0;
        for (_, instr) in self.tape.iter() {
            names.push(match *instr {
                Instr::Const(bits) => constant(f32::from_bits(bits)),
                Instr::Input(input) => self.input(input),
                Instr::Prim(prim, operands) => {
                    let operand = |k: usize| names[operands[k].index()].as_str();
                    let value = expression(name, prim, [0, 1, 2, 3].map(operand));
                    let variable = format!("v{statements}");
                    let _ = writeln!(text, "    const float {variable} = {value};");
                    statements += 1;
                    variable
                }
            });
        }
        let result: Value = self.tape.results()[0];
        let _ = writeln!(text, "    return {};\n}}", names[result.index()]);
        text
    }

    fn input(&self, input: Input) -> String {
        match input {
            Input::Plane(plane, side) => {
                let term = Term::of_plane(plane);
                let pixel = match side {
                    Side::I => "i",
                    Side::J => "j",
                };
                match term.components() {
                    1 => format!("{pixel}->{}", term.field()),
                    _ => format!("{pixel}->{}[{}]", term.field(), plane.component),
                }
            }
            Input::Offset(_) | Input::PerTap(_) => match axis_of(self.subject, input) {
                Some(Axis::X) => "dx".to_owned(),
                Some(Axis::Y) => "dy".to_owned(),
                None => unreachable!("what is known per tap are the bare offsets"),
            },
            Input::PerPixel(..) => unreachable!("the plan was made without rates"),
            Input::Signal(..) | Input::Constant(_) => {
                unreachable!("only programs have stages and named constants")
            }
        }
    }
}

/// The axis of an input that is an offset, read directly or through the tap
/// tape.
pub(super) fn axis_of(subject: &Subject<'_>, input: Input) -> Option<Axis> {
    match input {
        Input::Offset(axis) => Some(axis),
        Input::PerTap(k) => {
            let tap = subject.plan.tap();
            match tap.instr(tap.results()[k as usize]) {
                Instr::Input(input) => axis_of(subject, input),
                Instr::Const(_) | Instr::Prim(..) => None,
            }
        }
        Input::Plane(..) | Input::PerPixel(..) | Input::Signal(..) | Input::Constant(_) => None,
    }
}

/// The shortest decimal that is read back as the same number.
pub(super) fn constant(x: f32) -> String {
    assert!(x.is_finite(), "tapes hold finite constants");
    format!("{x:?}f")
}

/// A primitive applied to operands, each a name or a constant.
pub(super) fn expression(name: &str, prim: Prim, [a, b, c, d]: [&str; 4]) -> String {
    match prim {
        Prim::Neg => format!("-({a})"),
        Prim::Abs => format!("fabsf({a})"),
        Prim::Sqrt => format!("sqrtf({a})"),
        Prim::Round => format!("rintf({a})"),
        Prim::Exp2i => format!("{name}_exp2i({a})"),
        Prim::Exponent => format!("{name}_exponent({a})"),
        Prim::Fraction => format!("{name}_fraction({a})"),
        Prim::Add => format!("{a} + {b}"),
        Prim::Sub => format!("{a} - {b}"),
        Prim::Mul => format!("{a} * {b}"),
        Prim::Div => format!("{a} / {b}"),
        Prim::Min => format!("{a} < {b} ? {a} : {b}"),
        Prim::Max => format!("{a} > {b} ? {a} : {b}"),
        Prim::Fma => format!("fmaf({a}, {b}, {c})"),
        Prim::SelectLt => format!("{a} < {b} ? {c} : {d}"),
    }
}

/// The primitives that look at a number's bits.
pub(super) const BIT_TRICKS: &[(Prim, &str)] =
    &[(Prim::Exp2i, EXP2I), (Prim::Exponent, EXPONENT), (Prim::Fraction, FRACTION)];

/// [`EXP2I_MAGIC`], as the text says it.
const EXP2I: &str = "\
/* 2^a for an integer a in [-127, 127]; 2^-127 is flushed to 0. */
static float NAME_exp2i(float a)
{
    const float shifted = a + 12583039.0f;
    uint32_t bits;
    float power;
    memcpy(&bits, &shifted, sizeof bits);
    bits <<= 23;
    memcpy(&power, &bits, sizeof power);
    return power;
}
";
const _: () = assert!(EXP2I_MAGIC == 12_583_039.0);

/// [`ROOTS`], as the texts say them.
const _: () = assert!(ROOTS[0] == 0x3f35_04f4 && ROOTS[1] == 0x3eb5_04f4);

const EXPONENT: &str = "\
/* The integer nearest to log2 a, for a positive normal number.
   Shifts to the right are expected to keep the sign. */
static float NAME_exponent(float a)
{
    uint32_t bits;
    memcpy(&bits, &a, sizeof bits);
    return (float)((int32_t)(bits - 0x3f3504f4u) >> 23);
}
";

const FRACTION: &str = "\
/* a over two to the power NAME_exponent(a) + 1, between the roots of 1/8 and 1/2. */
static float NAME_fraction(float a)
{
    uint32_t bits;
    float fraction;
    memcpy(&bits, &a, sizeof bits);
    bits = ((bits - 0x3f3504f4u) & 0x007fffffu) + 0x3eb504f4u;
    memcpy(&fraction, &bits, sizeof fraction);
    return fraction;
}
";

#[cfg(test)]
mod tests {
    use std::fs;
    use std::process::Command;

    use super::*;

    /// Zeros, subnormals, ties of rounding, ends of exponents, limits and their
    /// neighbours.
    const PROBES: [f32; 22] = [
        0.0,
        -0.0,
        1e-45,
        -1.1754942e-38,
        f32::MIN_POSITIVE,
        0.5,
        -0.5,
        0.99999994,
        1.0,
        -1.0000001,
        1.5,
        -2.5,
        0.1,
        3.0,
        126.0,
        -127.0,
        127.0,
        8388609.0,
        -1e18,
        1e18,
        std::f32::consts::LOG2_E,
        f32::MAX,
    ];

    fn probes(prim: Prim) -> Vec<[f32; 4]> {
        let mut operands = vec![[0.0; 4]];
        for k in 0..prim.arity() {
            let with = |operands: [f32; 4], x: f32| {
                let mut operands = operands;
                operands[k] = x;
                operands
            };
            operands = operands
                .iter()
                .flat_map(|&operands| PROBES.map(|probe| with(operands, probe)))
                .collect();
        }
        operands
    }

    #[test]
    fn every_primitive_in_c_means_what_it_means_here() {
        let mut source = "#include <math.h>\n#include <stdint.h>\n#include <stdio.h>\n\
                          #include <string.h>\n"
            .to_owned();
        for (_, helper) in BIT_TRICKS {
            source.push_str(&helper.replace("NAME", "test"));
        }
        let numbers = PROBES.map(constant).join(", ");
        let count = PROBES.len();
        let _ = writeln!(source, "static const float probes[{count}] = {{{numbers}}};");
        source.push_str("int main(void)\n{\n    float x;\n");
        for prim in Prim::ALL {
            source.push_str("    {\n");
            for operand in &["a", "b", "c", "d"][..prim.arity()] {
                let _ = writeln!(
                    source,
                    "    for (int k{operand} = 0; k{operand} < {count}; ++k{operand}) {{\n    \
                     const float {operand} = probes[k{operand}];"
                );
            }
            let value = expression("test", prim, ["a", "b", "c", "d"]);
            let _ = writeln!(source, "    x = {value};\n    fwrite(&x, sizeof x, 1, stdout);");
            source.push_str(&"    }\n".repeat(prim.arity() + 1));
        }
        source.push_str("    return 0;\n}\n");

        let folder = tempfile::tempdir().expect("a temporary folder");
        fs::write(folder.path().join("primitives.c"), source).expect("writable");
        let mut compile = Command::new("cc");
        compile.current_dir(folder.path());
        compile.args(["-std=c99", "-O2", "-ffp-contract=off"]);
        compile.args(["-Wall", "-Wextra", "-Wpedantic", "-Werror"]);
        compile.args(["-o", "primitives", "primitives.c", "-lm"]);
        let compiled = compile.output().expect("there is a C compiler called cc");
        assert!(compiled.status.success(), "{}", String::from_utf8_lossy(&compiled.stderr));
        let run = Command::new(folder.path().join("primitives")).output().expect("it starts");
        let mut written = run.stdout.as_chunks::<4>().0.iter().map(|&x| f32::from_ne_bytes(x));
        for prim in Prim::ALL {
            for operands in probes(prim) {
                let (expected, got) = (prim.eval(operands), written.next().expect("all of them"));
                // Nothing is promised of the bits of what is no number.
                let same = expected.to_bits() == got.to_bits();
                assert!(
                    same || expected.is_nan() && got.is_nan(),
                    "{prim:?} of {operands:?} is {got:e} instead of {expected:e}"
                );
            }
        }
        assert_eq!(written.next(), None);
    }
}
