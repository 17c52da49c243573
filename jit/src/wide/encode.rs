//! Machine instructions: one method per kind, each of them for both widths.
//!
//! Registers and addresses are plain numbers here; what they hold is the business
//! of [`body`](super::body) and [`loops`](super::loops). Bytes come from
//! iced-x86's encoder.

use iced_x86::{Code, Encoder, IcedError, Instruction, MemoryOperand, Register};

use super::program::{Binary, Signs, Unary};
use crate::error::CompileError;
use crate::width::Width;

/// A vector register.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Vector(pub(super) u8);

/// An address: base + index + displacement, or a place in the constants.
#[derive(Clone, Copy, Debug)]
pub(super) enum Address {
    At {
        base: Register,
        index: Register,
        displacement: i64,
    },
    /// So many bytes behind the beginning of the constants.
    Pool(usize),
}

impl Address {
    pub(super) fn new(base: Register, displacement: usize) -> Self {
        Self::At { base, index: Register::None, displacement: displacement as i64 }
    }
}

/// Where an instruction finds an operand.
#[derive(Clone, Copy, Debug)]
pub(super) enum Operand {
    Register(Vector),
    /// A whole vector.
    Memory(Address),
    /// One float for all lanes; 512-bit instructions alone take it.
    Broadcast(Address),
}

/// An operand as instructions take it.
enum Encoded {
    Register(Register),
    Memory(MemoryOperand),
}

/// An instruction whose operand `$x` may be in memory.
macro_rules! with_operand {
    ($asm:expr, $operand:expr, |$x:ident| $instruction:expr) => {
        match $asm.encoded($operand) {
            Encoded::Register($x) => $instruction,
            Encoded::Memory($x) => $instruction,
        }
    };
}

/// Which operand of x × y + z the result overwrites, and in which order the
/// others come.
#[derive(Clone, Copy, Debug)]
pub(super) enum Fused {
    /// result = result × last + middle
    Order132,
    /// result = middle × result + last
    Order213,
    /// result = middle × last + result
    Order231,
}

/// Predicates of comparisons, quiet for NaN: less, not less, greater, not greater.
#[derive(Clone, Copy, Debug)]
pub(super) enum Predicate {
    Less = 0x11,
    NotLess = 0x15,
    Greater = 0x1e,
    NotGreater = 0x1a,
}

/// A branch that leads to nowhere yet.
#[must_use]
pub(super) struct Skip(usize);

/// Bytes of machine code, with the constants in front of it.
pub(super) struct Assembler {
    encoder: Encoder,
    width: Width,
    bytes: Vec<u8>,
    /// Where the next instruction goes.
    at: usize,
    /// Branches forward: where their instructions end, and where they lead.
    landed: Vec<(usize, usize)>,
    fault: Option<IcedError>,
}

/// Code starts on a cache line.
const LINE: usize = 64;

/// The mask register that selections go through; `k0` means "no mask".
const MASK: Register = Register::K1;

impl Assembler {
    /// Begins with these constants: each a float for every lane, or a single one
    /// where instructions can spread it.
    pub(super) fn new(width: Width, constants: &[u32]) -> Self {
        let copies = if width == Width::Bits512 { 1 } else { width.lanes() };
        let spread = |bits: &u32| bits.to_le_bytes().repeat(copies);
        let mut bytes: Vec<u8> = constants.iter().flat_map(spread).collect();
        bytes.resize(bytes.len().next_multiple_of(LINE), 0);
        let at = bytes.len();
        Self { encoder: Encoder::new(64), width, bytes, at, landed: Vec::new(), fault: None }
    }

    /// Where constant number `index` lies.
    pub(super) fn constant(&self, index: usize) -> Operand {
        match self.width {
            Width::Bits512 => Operand::Broadcast(Address::Pool(4 * index)),
            width => Operand::Memory(Address::Pool(width.bytes() * index)),
        }
    }

    /// Vector registers that there are.
    pub(super) fn registers(&self) -> u8 {
        Self::registers_of(self.width)
    }

    /// Vector registers that there are of a width.
    pub(super) fn registers_of(width: Width) -> u8 {
        if width == Width::Bits512 { 32 } else { 16 }
    }

    /// Where the next instruction goes: what a later branch can lead back to.
    pub(super) fn here(&self) -> usize {
        self.at
    }

    /// The constants and the code.
    pub(super) fn finish(mut self) -> Result<Vec<u8>, CompileError> {
        if let Some(fault) = self.fault {
            return Err(CompileError::Generator(fault.to_string()));
        }
        self.bytes.extend(self.encoder.take_buffer());
        for (end, target) in self.landed {
            let distance = (target - end) as i32;
            self.bytes[end - size_of::<i32>()..end].copy_from_slice(&distance.to_le_bytes());
        }
        Ok(self.bytes)
    }

    fn wide(&self) -> bool {
        self.width == Width::Bits512
    }

    fn code(&self, narrow: Code, wide: Code) -> Code {
        if self.wide() { wide } else { narrow }
    }

    fn register(&self, Vector(number): Vector) -> Register {
        let first = if self.wide() { Register::ZMM0 } else { Register::YMM0 };
        first + u32::from(number)
    }

    fn emit(&mut self, instruction: Result<Instruction, IcedError>) {
        let encoded = instruction.and_then(|i| self.encoder.encode(&i, self.at as u64));
        match encoded {
            Ok(length) => self.at += length,
            Err(fault) => self.fault = self.fault.take().or(Some(fault)),
        }
    }

    fn memory(address: Address, broadcast: bool) -> MemoryOperand {
        let (base, index, displacement) = match address {
            Address::At { base, index, displacement } => (base, index, displacement),
            // The encoder makes the distance from the instruction of it.
            Address::Pool(place) => (Register::RIP, Register::None, place as i64),
        };
        // A size of 1 lets the encoder choose the shortest displacement.
        let size = i32::from(displacement != 0 || base == Register::RIP);
        MemoryOperand::new(base, index, 1, displacement, size as u32, broadcast, Register::None)
    }

    fn encoded(&self, operand: Operand) -> Encoded {
        match operand {
            Operand::Register(vector) => Encoded::Register(self.register(vector)),
            Operand::Memory(at) => Encoded::Memory(Self::memory(at, false)),
            Operand::Broadcast(at) => Encoded::Memory(Self::memory(at, true)),
        }
    }

    fn emit2(&mut self, code: Code, to: Register, last: Operand) {
        self.emit(with_operand!(self, last, |last| Instruction::with2(code, to, last)));
    }

    fn emit3(&mut self, code: Code, to: Register, middle: Vector, last: Operand) {
        let middle = self.register(middle);
        self.emit(with_operand!(self, last, |last| Instruction::with3(code, to, middle, last)));
    }

    /// `to = value`.
    pub(super) fn load(&mut self, to: Vector, value: Operand) {
        let to = self.register(to);
        match value {
            Operand::Broadcast(at) => {
                let code = self
                    .code(Code::VEX_Vbroadcastss_ymm_m32, Code::EVEX_Vbroadcastss_zmm_k1z_xmmm32);
                self.emit2(code, to, Operand::Memory(at));
            }
            other => {
                let code =
                    self.code(Code::VEX_Vmovups_ymm_ymmm256, Code::EVEX_Vmovups_zmm_k1z_zmmm512);
                self.emit2(code, to, other);
            }
        }
    }

    /// Writes a vector to memory.
    pub(super) fn store(&mut self, to: Address, value: Vector) {
        let code = self.code(Code::VEX_Vmovups_ymmm256_ymm, Code::EVEX_Vmovups_zmmm512_k1z_zmm);
        let value = self.register(value);
        self.emit(Instruction::with2(code, Self::memory(to, false), value));
    }

    /// `to = +0.0`.
    pub(super) fn clear(&mut self, to: Vector) {
        self.binary(Binary::Xor, to, to, Operand::Register(to));
    }

    /// `to = op x`.
    pub(super) fn unary(&mut self, op: Unary, to: Vector, x: Operand) {
        let to = self.register(to);
        match op {
            Unary::Sqrt => {
                let code = self
                    .code(Code::VEX_Vsqrtps_ymm_ymmm256, Code::EVEX_Vsqrtps_zmm_k1z_zmmm512b32_er);
                self.emit2(code, to, x);
            }
            Unary::Convert => {
                let code = self.code(
                    Code::VEX_Vcvtdq2ps_ymm_ymmm256,
                    Code::EVEX_Vcvtdq2ps_zmm_k1z_zmmm512b32_er,
                );
                self.emit2(code, to, x);
            }
            Unary::Round => {
                // To nearest even, without signalling that anything was lost.
                let code = self.code(
                    Code::VEX_Vroundps_ymm_ymmm256_imm8,
                    Code::EVEX_Vrndscaleps_zmm_k1z_zmmm512b32_imm8_sae,
                );
                self.immediate(code, to, x, 8);
            }
            Unary::ShiftLeft(by) => {
                let code = self
                    .code(Code::VEX_Vpslld_ymm_ymm_imm8, Code::EVEX_Vpslld_zmm_k1z_zmmm512b32_imm8);
                self.immediate(code, to, x, by);
            }
            Unary::ShiftRight(by) => {
                let code = self
                    .code(Code::VEX_Vpsrad_ymm_ymm_imm8, Code::EVEX_Vpsrad_zmm_k1z_zmmm512b32_imm8);
                self.immediate(code, to, x, by);
            }
        }
    }

    /// Whether the operand of `op` may be in memory.
    pub(super) fn unary_takes_memory(&self, op: Unary) -> bool {
        self.wide() || !matches!(op, Unary::ShiftLeft(_) | Unary::ShiftRight(_))
    }

    fn immediate(&mut self, code: Code, to: Register, x: Operand, value: u8) {
        let value = u32::from(value);
        self.emit(with_operand!(self, x, |x| Instruction::with3(code, to, x, value)));
    }

    /// `to = x op y`.
    pub(super) fn binary(&mut self, op: Binary, to: Vector, x: Vector, y: Operand) {
        let (narrow, wide) = match op {
            Binary::Add => {
                (Code::VEX_Vaddps_ymm_ymm_ymmm256, Code::EVEX_Vaddps_zmm_k1z_zmm_zmmm512b32_er)
            }
            Binary::Sub => {
                (Code::VEX_Vsubps_ymm_ymm_ymmm256, Code::EVEX_Vsubps_zmm_k1z_zmm_zmmm512b32_er)
            }
            Binary::Mul => {
                (Code::VEX_Vmulps_ymm_ymm_ymmm256, Code::EVEX_Vmulps_zmm_k1z_zmm_zmmm512b32_er)
            }
            Binary::Div => {
                (Code::VEX_Vdivps_ymm_ymm_ymmm256, Code::EVEX_Vdivps_zmm_k1z_zmm_zmmm512b32_er)
            }
            Binary::Min => {
                (Code::VEX_Vminps_ymm_ymm_ymmm256, Code::EVEX_Vminps_zmm_k1z_zmm_zmmm512b32_sae)
            }
            Binary::Max => {
                (Code::VEX_Vmaxps_ymm_ymm_ymmm256, Code::EVEX_Vmaxps_zmm_k1z_zmm_zmmm512b32_sae)
            }
            // AVX-512F has these for integers alone.
            Binary::And => {
                (Code::VEX_Vandps_ymm_ymm_ymmm256, Code::EVEX_Vpandd_zmm_k1z_zmm_zmmm512b32)
            }
            Binary::Xor => {
                (Code::VEX_Vxorps_ymm_ymm_ymmm256, Code::EVEX_Vpxord_zmm_k1z_zmm_zmmm512b32)
            }
            Binary::IntegerSub => {
                (Code::VEX_Vpsubd_ymm_ymm_ymmm256, Code::EVEX_Vpsubd_zmm_k1z_zmm_zmmm512b32)
            }
        };
        let (code, to) = (self.code(narrow, wide), self.register(to));
        self.emit3(code, to, x, y);
    }

    /// `to`, `middle` and `last` multiplied and added in this order, with these signs.
    pub(super) fn fused(
        &mut self,
        order: Fused,
        signs: Signs,
        to: Vector,
        middle: Vector,
        last: Operand,
    ) {
        let (narrow, wide) = fused_codes(order, signs);
        let (code, to) = (self.code(narrow, wide), self.register(to));
        self.emit3(code, to, middle, last);
    }

    /// Compares; the result is a mask register at 512 bits, `mask` otherwise.
    pub(super) fn compare(&mut self, predicate: Predicate, mask: Vector, x: Vector, y: Operand) {
        let predicate = predicate as u32;
        let code = self.code(
            Code::VEX_Vcmpps_ymm_ymm_ymmm256_imm8,
            Code::EVEX_Vcmpps_kr_k1_zmm_zmmm512b32_imm8_sae,
        );
        let to = if self.wide() { MASK } else { self.register(mask) };
        let x = self.register(x);
        self.emit(with_operand!(self, y, |y| Instruction::with4(code, to, x, y, predicate)));
    }

    /// `to = if mask { chosen } else { other }`, after [`compare`](Self::compare).
    pub(super) fn blend(&mut self, to: Vector, mask: Vector, chosen: Operand, other: Vector) {
        let (to, other) = (self.register(to), self.register(other));
        let instruction = if self.wide() {
            let code = Code::EVEX_Vblendmps_zmm_k1z_zmm_zmmm512b32;
            let instruction =
                with_operand!(self, chosen, |x| Instruction::with3(code, to, other, x));
            instruction.map(|mut instruction| {
                instruction.set_op_mask(MASK);
                instruction
            })
        } else {
            let code = Code::VEX_Vblendvps_ymm_ymm_ymmm256_ymm;
            let mask = self.register(mask);
            with_operand!(self, chosen, |x| Instruction::with4(code, to, other, x, mask))
        };
        self.emit(instruction);
    }

    /// `to = *from`, eight bytes.
    pub(super) fn fetch(&mut self, to: Register, from: Address) {
        self.emit(Instruction::with2(Code::Mov_r64_rm64, to, Self::memory(from, false)));
    }

    /// `*to = from`, eight bytes.
    pub(super) fn put(&mut self, to: Address, from: Register) {
        self.emit(Instruction::with2(Code::Mov_rm64_r64, Self::memory(to, false), from));
    }

    /// `to = from`.
    pub(super) fn copy(&mut self, to: Register, from: Register) {
        self.emit(Instruction::with2(Code::Mov_r64_rm64, to, from));
    }

    /// `to += from`.
    pub(super) fn increase(&mut self, to: Register, from: Register) {
        self.emit(Instruction::with2(Code::Add_r64_rm64, to, from));
    }

    /// `to += *from`, eight bytes.
    pub(super) fn increase_by(&mut self, to: Register, from: Address) {
        self.emit(Instruction::with2(Code::Add_r64_rm64, to, Self::memory(from, false)));
    }

    /// `to += bytes`.
    pub(super) fn advance(&mut self, to: Register, bytes: usize) {
        self.emit(Instruction::with2(Code::Add_rm64_imm32, to, bytes as i32));
    }

    /// `*to += bytes`, eight bytes.
    pub(super) fn advance_at(&mut self, to: Address, bytes: usize) {
        let to = Self::memory(to, false);
        self.emit(Instruction::with2(Code::Add_rm64_imm32, to, bytes as i32));
    }

    /// `to = *from × factor`, eight bytes.
    pub(super) fn multiply(&mut self, to: Register, from: Address, factor: usize) {
        let from = Self::memory(from, false);
        self.emit(Instruction::with3(Code::Imul_r64_rm64_imm32, to, from, factor as i32));
    }

    /// Counts a register down, and goes back to `start` until it is 0.
    pub(super) fn repeat(&mut self, counter: Register, start: usize) {
        self.emit(Instruction::with1(Code::Dec_rm64, counter));
        self.emit(Instruction::with_branch(Code::Jne_rel32_64, start as u64));
    }

    /// The same with a counter in memory.
    pub(super) fn repeat_at(&mut self, counter: Address, start: usize) {
        self.emit(Instruction::with1(Code::Dec_rm64, Self::memory(counter, false)));
        self.emit(Instruction::with_branch(Code::Jne_rel32_64, start as u64));
    }

    /// Counts a register down; says "zero" at the end.
    pub(super) fn count_down(&mut self, counter: Register) {
        self.emit(Instruction::with1(Code::Dec_rm64, counter));
    }

    /// Halves a counter, the rest dropped; says "zero" if nothing is left.
    pub(super) fn halve(&mut self, counter: Register) {
        self.emit(Instruction::with2(Code::Shr_rm64_imm8, counter, 1));
    }

    /// Keeps of a counter whether it is odd; says "zero" if it is not.
    pub(super) fn keep_odd(&mut self, counter: Register) {
        self.emit(Instruction::with2(Code::And_rm64_imm8, counter, 1));
    }

    /// Branches forward if the last instruction said "zero".
    pub(super) fn skip_if_zero(&mut self) -> Skip {
        // Where to is not known yet: `land` says it, and `finish` writes it.
        self.emit(Instruction::with_branch(Code::Je_rel32_64, self.at as u64));
        Skip(self.at)
    }

    /// Ends what is skipped.
    pub(super) fn land(&mut self, Skip(end): Skip) {
        self.landed.push((end, self.at));
    }

    pub(super) fn push(&mut self, register: Register) {
        self.emit(Instruction::with1(Code::Push_r64, register));
    }

    pub(super) fn pop(&mut self, register: Register) {
        self.emit(Instruction::with1(Code::Pop_r64, register));
    }

    /// Returns, with the upper halves of the vectors as callers expect them.
    pub(super) fn leave(&mut self) {
        self.emit(Ok(Instruction::with(Code::VEX_Vzeroupper)));
        self.emit(Ok(Instruction::with(Code::Retnq)));
    }
}

/// The instructions of 256 and 512 bits.
fn fused_codes(order: Fused, signs: Signs) -> (Code, Code) {
    match (order, signs) {
        (Fused::Order132, Signs::Plus) => (
            Code::VEX_Vfmadd132ps_ymm_ymm_ymmm256,
            Code::EVEX_Vfmadd132ps_zmm_k1z_zmm_zmmm512b32_er,
        ),
        (Fused::Order213, Signs::Plus) => (
            Code::VEX_Vfmadd213ps_ymm_ymm_ymmm256,
            Code::EVEX_Vfmadd213ps_zmm_k1z_zmm_zmmm512b32_er,
        ),
        (Fused::Order231, Signs::Plus) => (
            Code::VEX_Vfmadd231ps_ymm_ymm_ymmm256,
            Code::EVEX_Vfmadd231ps_zmm_k1z_zmm_zmmm512b32_er,
        ),
        (Fused::Order132, Signs::Minus) => (
            Code::VEX_Vfmsub132ps_ymm_ymm_ymmm256,
            Code::EVEX_Vfmsub132ps_zmm_k1z_zmm_zmmm512b32_er,
        ),
        (Fused::Order213, Signs::Minus) => (
            Code::VEX_Vfmsub213ps_ymm_ymm_ymmm256,
            Code::EVEX_Vfmsub213ps_zmm_k1z_zmm_zmmm512b32_er,
        ),
        (Fused::Order231, Signs::Minus) => (
            Code::VEX_Vfmsub231ps_ymm_ymm_ymmm256,
            Code::EVEX_Vfmsub231ps_zmm_k1z_zmm_zmmm512b32_er,
        ),
        (Fused::Order132, Signs::NegatedPlus) => (
            Code::VEX_Vfnmadd132ps_ymm_ymm_ymmm256,
            Code::EVEX_Vfnmadd132ps_zmm_k1z_zmm_zmmm512b32_er,
        ),
        (Fused::Order213, Signs::NegatedPlus) => (
            Code::VEX_Vfnmadd213ps_ymm_ymm_ymmm256,
            Code::EVEX_Vfnmadd213ps_zmm_k1z_zmm_zmmm512b32_er,
        ),
        (Fused::Order231, Signs::NegatedPlus) => (
            Code::VEX_Vfnmadd231ps_ymm_ymm_ymmm256,
            Code::EVEX_Vfnmadd231ps_zmm_k1z_zmm_zmmm512b32_er,
        ),
        (Fused::Order132, Signs::NegatedMinus) => (
            Code::VEX_Vfnmsub132ps_ymm_ymm_ymmm256,
            Code::EVEX_Vfnmsub132ps_zmm_k1z_zmm_zmmm512b32_er,
        ),
        (Fused::Order213, Signs::NegatedMinus) => (
            Code::VEX_Vfnmsub213ps_ymm_ymm_ymmm256,
            Code::EVEX_Vfnmsub213ps_zmm_k1z_zmm_zmmm512b32_er,
        ),
        (Fused::Order231, Signs::NegatedMinus) => (
            Code::VEX_Vfnmsub231ps_ymm_ymm_ymmm256,
            Code::EVEX_Vfnmsub231ps_zmm_k1z_zmm_zmmm512b32_er,
        ),
    }
}
