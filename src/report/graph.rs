//! A program as a drawing: a box per stage, and who reads whom.
//!
//! Stages stand in rows, each below all that it reads (longest paths). A line from row to row
//! passes places of its own, so that none runs through a box, and rows are put in the order that
//! makes lines short: a few sweeps of medians (Sugiyama, Tagawa, Toda, 1981).

use std::collections::BTreeMap;

use askama::Template;

use crate::expr::feature::Feature;
use crate::expr::symbol::Symbol;
use crate::expr::tree::Tree;
use crate::filter::{Filter, Gather, Grid, Stage, StageKind, spelling};

/// A box, in pixels, and the room around it.
const WIDTH: f64 = 190.0;
const HEIGHT: f64 = 58.0;
const GAP: [f64; 2] = [22.0, 46.0];

/// The room that a line takes which passes a row.
const LANE: f64 = 16.0;

/// Letters that fit into a box.
const LETTERS: usize = 27;

/// How often rows are put in order, down and up.
const SWEEPS: usize = 6;

#[derive(Template)]
#[template(path = "graph.svg", escape = "html")]
struct Drawing {
    width: f64,
    height: f64,
    lines: Vec<Line>,
    boxes: Vec<Block>,
}

struct Line {
    path: String,
    /// Whether it is only looked at by a weight.
    weighs: bool,
    title: String,
}

struct Block {
    x: f64,
    y: f64,
    kind: &'static str,
    name: String,
    what: String,
    reads: String,
    title: String,
}

/// What stands in a row: a stage, or a line that passes.
#[derive(Clone, Copy, PartialEq)]
enum Item {
    Stage(usize),
    Passing { from: usize, to: usize },
}

/// A filter's stages as SVG: maps and gathers with their windows and the features that they read,
/// and lines from who is read to who reads, dashed where a weight alone looks.
pub fn stages(filter: &Filter) -> String {
    let count = filter.stages.len();
    let reads: Vec<BTreeMap<usize, bool>> = filter.stages.iter().map(read).collect();
    let mut ranks = vec![0; count];
    for k in 0..count {
        ranks[k] = reads[k].keys().map(|&from| ranks[from] + 1).max().unwrap_or(0);
    }
    let rows = ordered(rows(&reads, &ranks), &reads);
    let places = places(&rows);
    let right = places.values().map(|[x, _]| x + WIDTH / 2.0).fold(0.0, f64::max);
    let mut lines = Vec::new();
    for (to, sources) in reads.iter().enumerate() {
        for (&from, &weighs) in sources {
            let [x, y] = places[&key(Item::Stage(from), ranks[from])];
            let mut path = format!("M{x:.1} {:.1}", y + HEIGHT / 2.0);
            let mut at = [x, y + HEIGHT / 2.0];
            for rank in ranks[from] + 1..=ranks[to] {
                let end = rank == ranks[to];
                let item = if end { Item::Stage(to) } else { Item::Passing { from, to } };
                let [x, y] = places[&key(item, rank)];
                let top = y - HEIGHT / 2.0;
                let middle = (at[1] + top) / 2.0;
                path += &format!(" C{:.1} {middle:.1} {x:.1} {middle:.1} {x:.1} {top:.1}", at[0]);
                if !end {
                    path += &format!(" V{:.1}", top + HEIGHT);
                }
                at = [x, top + HEIGHT];
            }
            let [from, to] = [from, to].map(|k| &filter.stages[k].name);
            lines.push(Line { path, weighs, title: format!("{to} reads {from}") });
        }
    }
    let boxes = filter.stages.iter().enumerate().map(|(k, stage)| {
        let [x, y] = places[&key(Item::Stage(k), ranks[k])];
        block(stage, [x - WIDTH / 2.0, y - HEIGHT / 2.0])
    });
    let height = rows.len() as f64 * (HEIGHT + GAP[1]);
    Drawing { width: right + GAP[0], height, lines, boxes: boxes.collect() }
        .render()
        .expect("a drawing is text")
}

/// The stages that a stage reads, and whether its weight alone does.
fn read(stage: &Stage) -> BTreeMap<usize, bool> {
    let mut found = BTreeMap::new();
    let mut look = |tree: &Tree, weighs: bool| {
        for &symbol in tree.symbols() {
            if let Symbol::Stage(signal) = symbol {
                let weighs_only = found.entry(usize::from(signal.stage)).or_insert(true);
                *weighs_only &= weighs;
            }
        }
    };
    match &stage.kind {
        StageKind::Map(value) => look(value, false),
        StageKind::Gather(Gather { of, weight, variance, .. }) => {
            look(of, false);
            look(weight, true);
            variance.iter().for_each(|variance| look(variance, false));
        }
    }
    found
}

fn rows(reads: &[BTreeMap<usize, bool>], ranks: &[usize]) -> Vec<Vec<Item>> {
    let last = ranks.iter().copied().max().unwrap_or(0);
    let mut rows = vec![Vec::new(); last + 1];
    for (k, &rank) in ranks.iter().enumerate() {
        rows[rank].push(Item::Stage(k));
    }
    for (to, sources) in reads.iter().enumerate() {
        for &from in sources.keys() {
            for row in &mut rows[ranks[from] + 1..ranks[to]] {
                row.push(Item::Passing { from, to });
            }
        }
    }
    rows
}

/// The rows with what belongs together about one below the other.
fn ordered(mut rows: Vec<Vec<Item>>, reads: &[BTreeMap<usize, bool>]) -> Vec<Vec<Item>> {
    let joined = |above: Item, below: Item| match (above, below) {
        (Item::Stage(from), Item::Stage(to)) => reads[to].contains_key(&from),
        (Item::Stage(stage), Item::Passing { from, .. }) => stage == from,
        (Item::Passing { to, .. }, Item::Stage(stage)) => stage == to,
        (above, below) => above == below,
    };
    for sweep in 0..SWEEPS {
        let down = sweep % 2 == 0;
        let order: Vec<usize> =
            if down { (1..rows.len()).collect() } else { (0..rows.len() - 1).rev().collect() };
        for k in order {
            let other = rows[if down { k - 1 } else { k + 1 }].clone();
            let share = |at: usize| (at as f64 + 0.5) / other.len() as f64;
            let count = rows[k].len() as f64;
            let place = |(at, item): (usize, Item)| {
                let is_joined = |(_, o): &(usize, &Item)| match down {
                    true => joined(**o, item),
                    false => joined(item, **o),
                };
                let joined: Vec<usize> =
                    other.iter().enumerate().filter(is_joined).map(|(at, _)| at).collect();
                // Who is joined to nobody stays.
                let place = match joined.len() {
                    0 => (at as f64 + 0.5) / count,
                    n => (share(joined[(n - 1) / 2]) + share(joined[n / 2])) / 2.0,
                };
                (place, item)
            };
            let mut placed: Vec<(f64, Item)> =
                rows[k].iter().copied().enumerate().map(place).collect();
            placed.sort_by(|(a, _), (b, _)| a.total_cmp(b));
            rows[k] = placed.into_iter().map(|(_, item)| item).collect();
        }
    }
    rows
}

/// What tells an item of a row from all others.
type Key = (usize, usize, usize);

fn key(item: Item, rank: usize) -> Key {
    match item {
        Item::Stage(k) => (rank, k, usize::MAX),
        Item::Passing { from, to } => (rank, from, to),
    }
}

/// The middle of every item, rows one below the other and centred.
fn places(rows: &[Vec<Item>]) -> BTreeMap<Key, [f64; 2]> {
    let room = |item: &Item| match item {
        Item::Stage(_) => WIDTH + GAP[0],
        Item::Passing { .. } => LANE,
    };
    let width = |row: &Vec<Item>| row.iter().map(room).sum::<f64>();
    let widest = rows.iter().map(width).fold(0.0, f64::max);
    let mut places = BTreeMap::new();
    for (rank, row) in rows.iter().enumerate() {
        let y = (rank as f64 + 0.5) * (HEIGHT + GAP[1]);
        let mut x = (widest - width(row)) / 2.0 + GAP[0] / 2.0;
        for item in row {
            places.insert(key(*item, rank), [x + room(item) / 2.0, y]);
            x += room(item);
        }
    }
    places
}

fn block(stage: &Stage, [x, y]: [f64; 2]) -> Block {
    let half = if stage.grid == Grid::Half { ", half resolution" } else { "" };
    let (kind, what) = match &stage.kind {
        StageKind::Map(_) => ("map", format!("map{half}")),
        StageKind::Gather(gather) => {
            let taps = gather.window.diameter();
            let apart = match gather.window.dilation {
                1 => String::new(),
                dilation => format!(", {dilation} apart"),
            };
            ("gather", format!("gather {taps}x{taps}{apart}{half}"))
        }
    };
    let mut terms: Vec<&str> = Vec::new();
    for &symbol in stage.trees().flat_map(Tree::symbols) {
        let read = symbol.reads().filter(|(feature, _)| *feature != Feature::Pixel);
        match read.and_then(|(feature, quantity)| spelling(feature, quantity)) {
            Some(term) if !terms.contains(&term) => terms.push(term),
            Some(_) | None => {}
        }
    }
    let reads = terms.join(", ");
    Block {
        x,
        y,
        kind,
        title: match reads.as_str() {
            "" => format!("{}: {what}", stage.name),
            _ => format!("{}: {what}; reads {reads}", stage.name),
        },
        name: short(&stage.name),
        what: short(&what),
        reads: short(&reads),
    }
}

/// As much of a text as fits into a box.
fn short(text: &str) -> String {
    match text.chars().count() {
        ..=LETTERS => text.to_owned(),
        _ => text.chars().take(LETTERS - 1).chain(['…']).collect(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::filter::shipped;

    fn numbers(node: roxmltree::Node<'_, '_>, names: [&str; 4]) -> [f64; 4] {
        names.map(|name| node.attribute(name).expect("a number").parse().expect("a number"))
    }

    #[test]
    fn every_stage_has_a_box_and_every_reader_a_line() {
        for filter in shipped::programs() {
            let svg = stages(&filter);
            let document = roxmltree::Document::parse(&svg).expect("SVG is XML");
            let of = |class: &str| {
                let found = document.descendants().filter(|n| n.attribute("class") == Some(class));
                found.collect::<Vec<_>>()
            };
            let boxes: Vec<[f64; 4]> = document
                .descendants()
                .filter(|node| node.has_tag_name("rect"))
                .map(|node| numbers(node, ["x", "y", "width", "height"]))
                .collect();
            assert_eq!(boxes.len(), filter.stages.len(), "{}", filter.name);
            for (k, [x, y, w, h]) in boxes.iter().enumerate() {
                let apart = |[u, v, ..]: &[f64; 4]| (x - u).abs() >= *w || (y - v).abs() >= *h;
                assert!(boxes[..k].iter().all(apart), "boxes over each other in {}", filter.name);
            }
            let reads: usize = filter.stages.iter().map(|stage| read(stage).len()).sum();
            assert_eq!(of("reads").len() + of("weighs").len(), reads, "{}", filter.name);
            assert!(!of("weighs").is_empty(), "{}", filter.name);
        }
    }

    #[test]
    fn a_reader_stands_below_what_it_reads() {
        let text = "version = 2\nname = \"x\"\n[[stage]]\nname = \"a\"\nmap = \"color\"\n\
                    [[stage]]\nname = \"b\"\ngather = \"a\"\nweight = \"mean(albedo[i]) / (1 + depth[i])\"\n\
                    radius = 2\ndilation = 4\n[[stage]]\nname = \"c\"\nmap = \"a + b\"\n";
        let filter = Filter::parse(text, "x.toml".as_ref()).expect("a filter");
        let svg = stages(&filter);
        assert!(svg.contains("gather 5x5, 4 apart"), "{svg}");
        // As formulas have it, and not as the paper does.
        assert!(svg.contains("reads albedo, depth"), "{svg}");
        let document = roxmltree::Document::parse(&svg).expect("SVG is XML");
        let tops = document.descendants().filter(|node| node.has_tag_name("rect"));
        let tops: Vec<f64> = tops.map(|node| numbers(node, ["y"; 4])[0]).collect();
        assert!(tops[0] < tops[1] && tops[1] < tops[2], "{tops:?}");
    }
}
