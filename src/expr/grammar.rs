//! The search's grammar (the paper's Figure 2), read off the rows of the
//! operators and the features.
//!
//! A [`Vocabulary`] is the set of symbols that a search may use: the operators of
//! a primitive set ([`Primitives`]), and the features, or those that remain when
//! the scenes lack one. It makes random expressions, finds the symbols that the
//! *replace* mutation may put in another's place, and prints itself as EBNF. What
//! it makes is well-sorted by construction, and [`Tree`] checks it all the same.
//!
//! A seed names a search only as long as its operators and their order stay what
//! they are. So searches name their primitive set, and the paper's is a list of its
//! own: a new row of the operator table is in no set that does not name it.

use rand::seq::{IndexedRandom, IteratorRandom};
use rand::{Rng, RngExt};
use serde::{Deserialize, Serialize};

use super::feature::{Feature, Quantity};
use super::op::{Form, Op, Sort};
use super::symbol::Symbol;
use super::tree::Tree;

/// The paper's ⟨const⟩.
pub const CONSTANTS: [f32; 8] = [0.1, 0.2, 0.3, 0.3333, 1.0, 2.0, 3.0, std::f32::consts::PI];

/// The features of the paper's Section 4.3, and of its Equations 3 and 4.
pub const PAPER_FEATURES: &[Feature] = &[
    Feature::WorldPosition,
    Feature::Normal,
    Feature::Texture,
    Feature::SecTexture,
    Feature::Depth,
    Feature::DirIllumination,
    Feature::Color,
    Feature::Pixel,
];

/// The operators of the paper's Figure 2, in its order.
pub const PAPER: &[Op] = &[
    Op::Neg,
    Op::Sin,
    Op::Cos,
    Op::Tan,
    Op::Exp,
    Op::Asin,
    Op::Acos,
    Op::Atan,
    Op::Sqrt,
    Op::Mitchell,
    Op::Sinc,
    Op::Epanechnikov,
    Op::Biweight,
    Op::Tricube,
    Op::Mul,
    Op::Sub,
    Op::Add,
    Op::Div,
    Op::Pow,
    Op::Dot,
    Op::Distance2,
    Op::Distance1,
    Op::DistanceMax,
];

/// A set of operators that searches name.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Primitives {
    /// [`PAPER`] and [`PAPER_FEATURES`].
    #[default]
    Paper,
    /// Every row of the operator table and of the features'. What a seed names changes when a
    /// row is added.
    All,
}

impl Primitives {
    /// Both.
    pub const ALL: [Self; 2] = [Self::Paper, Self::All];

    /// The set's name in settings.
    pub fn name(self) -> &'static str {
        match self {
            Self::Paper => "paper",
            Self::All => "all",
        }
    }

    /// The set of a name.
    pub fn named(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|set| set.name() == name)
    }

    /// The features, in the order in which random choices count them.
    pub fn features(self) -> &'static [Feature] {
        match self {
            Self::Paper => PAPER_FEATURES,
            Self::All => &Feature::ALL,
        }
    }

    /// The operators, in the order in which random choices count them.
    pub fn ops(self) -> &'static [Op] {
        match self {
            Self::Paper => PAPER,
            Self::All => Op::ALL,
        }
    }
}

/// The symbols that a search may use.
#[derive(Clone, Debug, PartialEq)]
pub struct Vocabulary {
    constants: Vec<Symbol>,
    variances: Vec<Symbol>,
    vectors: Vec<Symbol>,
    ops: Vec<Op>,
    paired: f64,
}

/// How large a random expression may be.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Limits {
    /// Levels; 1 allows leaves only.
    pub depth: usize,
    /// Nodes.
    pub nodes: usize,
}

impl Vocabulary {
    /// Everything that the language has.
    pub fn all() -> Self {
        Self::of(Primitives::All, |_, _| true)
    }

    /// A primitive set with those quantities of features that `keep` accepts.
    pub fn of(primitives: Primitives, keep: impl Fn(Feature, Quantity) -> bool) -> Self {
        let (mut variances, mut vectors) = (Vec::new(), Vec::new());
        let terms = Feature::terms().filter(|(f, _)| primitives.features().contains(f));
        for (feature, quantity) in terms.filter(|&(f, q)| keep(f, q)) {
            let symbol = Symbol::of(feature, quantity).expect("terms() lists what has a spelling");
            match symbol.sort() {
                Sort::Scalar => variances.push(symbol),
                Sort::Vector => vectors.push(symbol),
            }
        }
        // Without vectors there is nothing to take the distance of.
        let usable = |op: &Op| !op.operands().contains(&Sort::Vector) || !vectors.is_empty();
        Self {
            constants: CONSTANTS.map(Symbol::constant).to_vec(),
            variances,
            ops: primitives.ops().iter().copied().filter(usable).collect(),
            vectors,
            paired: 0.0,
        }
    }

    /// The same symbols, with both operands of a random vector operator made
    /// the same vector with this probability (clamped into [0, 1]). The paper's
    /// grammar, and the default, is 0: two independent vectors, most of whose
    /// distances mean little.
    #[must_use]
    pub fn paired(self, probability: f64) -> Self {
        let paired = if probability.is_nan() { 0.0 } else { probability.clamp(0.0, 1.0) };
        Self { paired, ..self }
    }

    /// Whether the symbol may be used. Literals of any value may: besides the
    /// paper's constants, codebook and filters bring in their own.
    pub fn contains(&self, symbol: Symbol) -> bool {
        match symbol {
            Symbol::Const(_) => true,
            Symbol::Variance(_) => self.variances.contains(&symbol),
            Symbol::Vector(_) | Symbol::Gradient(_) => self.vectors.contains(&symbol),
            Symbol::Op(op) => self.ops.contains(&op),
            _ => false,
        }
    }

    /// Whether the tree is one that the paper's grammar makes of these symbols.
    pub fn covers(&self, tree: &Tree) -> bool {
        tree.is_paper() && tree.symbols().iter().all(|&symbol| self.contains(symbol))
    }

    /// The symbols that may stand in another's place: those that take the same
    /// operands and give the same sort, itself left out.
    pub fn compatible(&self, symbol: Symbol) -> impl Iterator<Item = Symbol> + '_ {
        self.symbols().filter(move |&other| {
            other != symbol
                && other.sort() == symbol.sort()
                && other.operands() == symbol.operands()
        })
    }

    /// A random symbol among the [`compatible`](Self::compatible) ones.
    pub fn replacement(&self, rng: &mut impl Rng, symbol: Symbol) -> Option<Symbol> {
        self.compatible(symbol).choose(rng)
    }

    /// Every symbol.
    pub fn symbols(&self) -> impl Iterator<Item = Symbol> + '_ {
        let leaves = self.constants.iter().chain(&self.variances).chain(&self.vectors).copied();
        leaves.chain(self.ops.iter().copied().map(Symbol::Op))
    }

    /// A random scalar expression within the limits (both at least 1).
    ///
    /// Where the grammar has alternatives each is equally likely, as far as the
    /// limits leave them open: an operator or a scalar, then a unary, a binary
    /// or a vector operator, then which one. Nodes are made level by level, so
    /// that a tight limit on nodes is shared by both operands instead of being
    /// spent on the left one.
    pub fn random_tree(&self, rng: &mut impl Rng, limits: Limits) -> Tree {
        /// A node whose operands are `first..first + arity`.
        struct Node {
            symbol: Symbol,
            level: usize,
            first: usize,
        }
        let placeholder = |level| Node { symbol: self.constants[0], level, first: 0 };
        let mut nodes = vec![placeholder(1)];
        let mut k = 0;
        while k < nodes.len() {
            let (level, first) = (nodes[k].level, nodes.len());
            let room = if level < limits.depth { limits.nodes.saturating_sub(first) } else { 0 };
            // Vectors are chosen with their operator.
            if nodes[k].symbol.sort() == Sort::Scalar {
                let symbol = self.random_node(rng, room);
                nodes[k] = Node { symbol, level, first };
                nodes.extend(symbol.operands().iter().map(|_| placeholder(level + 1)));
                if symbol.operands().contains(&Sort::Vector) {
                    for (node, vector) in nodes[first..].iter_mut().zip(self.random_vectors(rng)) {
                        node.symbol = vector;
                    }
                }
            }
            k += 1;
        }
        // Operators before their operands, the last operand first: postfix backwards.
        let mut symbols = Vec::with_capacity(nodes.len());
        let mut pending = vec![0];
        while let Some(k) = pending.pop() {
            let Node { symbol, first, .. } = nodes[k];
            symbols.push(symbol);
            pending.extend(first..first + symbol.arity());
        }
        symbols.reverse();
        Tree::new(symbols).expect("every operator was given the operands it takes")
    }

    /// ⟨node⟩, of an operator with at most `room` operands.
    fn random_node(&self, rng: &mut impl Rng, room: usize) -> Symbol {
        let kinds = OpKind::ALL.into_iter().filter(|kind| kind.arity() <= room);
        let kind = kinds.filter(|&kind| self.ops_of(kind).next().is_some()).choose(rng);
        match kind {
            Some(kind) if rng.random_bool(0.5) => {
                let op =
                    self.ops_of(kind).choose(rng).expect("kinds without operators are left out");
                Symbol::Op(op)
            }
            Some(_) | None => self.random_scalar(rng),
        }
    }

    /// ⟨scalar⟩: a variance or one of the paper's constants.
    pub fn random_scalar(&self, rng: &mut impl Rng) -> Symbol {
        let variance = rng.random_bool(0.5).then(|| self.variances.choose(rng)).flatten();
        let scalar = variance.or_else(|| self.constants.choose(rng));
        *scalar.expect("the paper's constants are always there")
    }

    /// The operands of a vector operator.
    fn random_vectors(&self, rng: &mut impl Rng) -> [Symbol; 2] {
        const HAS_VECTORS: &str = "a vocabulary without vectors has no vector operators";
        let first = *self.vectors.choose(rng).expect(HAS_VECTORS);
        if rng.random_bool(self.paired) {
            return [first, first];
        }
        [first, *self.vectors.choose(rng).expect(HAS_VECTORS)]
    }

    fn ops_of(&self, kind: OpKind) -> impl Iterator<Item = Op> + '_ {
        self.ops.iter().copied().filter(move |&op| OpKind::of(op) == kind)
    }

    /// The grammar in EBNF, in the manner of the paper's Figure 2.
    pub fn ebnf(&self) -> String {
        let quoted = |names: Vec<String>| -> String {
            let quoted: Vec<String> = names.iter().map(|name| format!("\"{name}\"")).collect();
            if quoted.is_empty() { "(* none *)".to_owned() } else { quoted.join(" | ") }
        };
        let spelled = |symbols: &[Symbol]| -> String {
            let leaf = |&symbol: &Symbol| Tree::leaf(symbol).expect("these symbols are leaves");
            quoted(symbols.iter().map(|symbol| leaf(symbol).to_string()).collect())
        };
        let operators = |kind| quoted(self.ops_of(kind).map(|op| op.name().to_owned()).collect());
        let rules = [
            ("expression", "node".to_owned()),
            ("node", "op | scalar".to_owned()),
            (
                "op",
                "unaryOp \"(\" node \")\" | binaryOp \"(\" node \",\" node \")\" | vectorOp \"(\" vector \",\" vector \")\"".to_owned(),
            ),
            ("unaryOp", operators(OpKind::Unary)),
            ("binaryOp", operators(OpKind::Binary)),
            ("vectorOp", operators(OpKind::Vectors)),
            ("vector", spelled(&self.vectors)),
            ("scalar", "variable | const".to_owned()),
            ("variable", spelled(&self.variances)),
            ("const", spelled(&self.constants)),
        ];
        rules.map(|(name, rule)| format!("{name:10} = {rule} ;\n")).concat()
    }
}

/// The paper's three classes of operator.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum OpKind {
    Unary,
    Binary,
    Vectors,
}

impl OpKind {
    const ALL: [Self; 3] = [Self::Unary, Self::Binary, Self::Vectors];

    fn of(op: Op) -> Self {
        match op.row().form {
            Form::Unary(_) => Self::Unary,
            Form::Binary(_) => Self::Binary,
            Form::Vectors(_) => Self::Vectors,
        }
    }

    fn arity(self) -> usize {
        match self {
            Self::Unary => 1,
            Self::Binary | Self::Vectors => 2,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::SeedableRng;
    use rand_chacha::ChaCha8Rng;

    fn rng() -> ChaCha8Rng {
        ChaCha8Rng::seed_from_u64(7)
    }

    #[test]
    fn random_trees_keep_to_the_limits_and_the_vocabulary() {
        let vocabulary =
            Vocabulary::of(Primitives::All, |feature, _| feature != Feature::SecTexture);
        let mut rng = rng();
        let (mut deepest, mut largest) = (0, 0);
        for k in 0..20_000 {
            let limits = Limits { depth: 1 + k % 6, nodes: 1 + k % 11 };
            let tree = vocabulary.random_tree(&mut rng, limits);
            assert!(tree.depth() <= limits.depth && tree.len() <= limits.nodes);
            assert_eq!(tree.sort(), Sort::Scalar);
            assert!(vocabulary.covers(&tree), "{tree}");
            assert_eq!(tree.to_string().parse(), Ok(tree.clone()));
            (deepest, largest) = (deepest.max(tree.depth()), largest.max(tree.len()));
        }
        assert_eq!((deepest, largest), (6, 11), "the limits can be reached");
    }

    #[test]
    fn random_trees_use_every_symbol() {
        let vocabulary = Vocabulary::all();
        let mut rng = rng();
        let mut unseen: Vec<Symbol> = vocabulary.symbols().collect();
        for _ in 0..20_000 {
            let tree = vocabulary.random_tree(&mut rng, Limits { depth: 5, nodes: 20 });
            unseen.retain(|symbol| !tree.symbols().contains(symbol));
        }
        assert_eq!(unseen, []);
    }

    #[test]
    fn a_seed_names_a_tree() {
        let limits = Limits { depth: 8, nodes: 30 };
        let make = || Vocabulary::all().random_tree(&mut rng(), limits);
        assert_eq!(make(), make());
    }

    #[test]
    fn a_vocabulary_without_vectors_still_makes_expressions() {
        let vocabulary = Vocabulary::of(Primitives::All, |_, _| false);
        assert!(!vocabulary.contains(Symbol::Op(Op::Dot)));
        let mut rng = rng();
        for _ in 0..1000 {
            vocabulary.random_tree(&mut rng, Limits { depth: 6, nodes: 20 });
        }
    }

    #[test]
    fn pairing_makes_both_operands_the_same() {
        let vocabulary = Vocabulary::all();
        let share = |vocabulary: &Vocabulary| {
            let mut rng = rng();
            let pairs: Vec<[Symbol; 2]> =
                (0..4000).map(|_| vocabulary.random_vectors(&mut rng)).collect();
            pairs.iter().filter(|[a, b]| a == b).count() as f64 / pairs.len() as f64
        };
        let chance = 1.0 / vocabulary.vectors.len() as f64;
        assert!((share(&vocabulary) - chance).abs() < 0.02);
        assert!((share(&vocabulary.clone().paired(0.75)) - 0.75 - 0.25 * chance).abs() < 0.02);
        assert_eq!(share(&vocabulary.paired(1.0)), 1.0);
    }

    #[test]
    fn compatible_symbols_fit_wherever_the_symbol_stood() {
        let vocabulary = Vocabulary::all();
        let mut rng = rng();
        for _ in 0..2000 {
            let tree = vocabulary.random_tree(&mut rng, Limits { depth: 6, nodes: 20 });
            for (position, &symbol) in tree.symbols().iter().enumerate() {
                let other = vocabulary.replacement(&mut rng, symbol).expect("all have company");
                assert_ne!(other, symbol);
                assert!(tree.with_symbol(position, other).is_ok(), "{other:?} in {tree}");
            }
        }
        let names: Vec<&str> = vocabulary
            .compatible(Symbol::Op(Op::Dot))
            .map(|symbol| match symbol {
                Symbol::Op(op) => op.name(),
                leaf => panic!("{leaf:?} takes no vectors"),
            })
            .collect();
        assert_eq!(names, ["distance2", "distance1", "distanceMax"]);
    }

    #[test]
    fn the_grammar_is_the_papers_figure_2() {
        insta::assert_snapshot!(Vocabulary::of(Primitives::Paper, |_, _| true).ebnf());
    }

    /// Names and numbers are written out here: whatever the operator table becomes, the
    /// paper's searches draw from these, in this order.
    #[test]
    fn the_papers_primitives_are_independent_of_the_operator_table() {
        let names: Vec<&str> = PAPER.iter().map(|op| op.name()).collect();
        let figure_2 = "- sin cos tan exp asin acos atan sqrt mitchell sinc epanechnikov biweight \
                        tricube * - + / pow dot distance2 distance1 distanceMax";
        assert_eq!(names, figure_2.split(' ').collect::<Vec<_>>());
        assert!(PAPER.iter().all(|op| Op::ALL.contains(op)));
        let count = |kind| PAPER.iter().filter(|&&op| OpKind::of(op) == kind).count();
        assert_eq!(OpKind::ALL.map(count), [14, 5, 4]);
        let vocabulary = Vocabulary::of(Primitives::Paper, |_, _| true);
        assert_eq!(vocabulary.ops, PAPER);
    }

    /// The same seed has to make these trees for ever.
    #[test]
    fn a_seed_names_trees_of_the_papers_grammar() {
        let vocabulary = Vocabulary::of(Primitives::Paper, |_, _| true);
        let mut rng = rng();
        let limits = Limits { depth: 6, nodes: 20 };
        let trees = [(); 6].map(|()| vocabulary.random_tree(&mut rng, limits).to_string());
        assert_eq!(
            trees,
            [
                "distanceMax(nGradient, dirIllumination)",
                "wpVariance",
                "distance2(nGradient, worldPosition) / distanceMax(secTGradient, color) / 0.3 - 0.3",
                "cos(dot(secTexture, depth))",
                "wpVariance - tVariance",
                "dot(wpGradient, normal)",
            ]
        );
    }
}
