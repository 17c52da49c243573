//! The floors of ARCHITECTURE.md: imports point down only, and files know each other one way, those
//! of the C library too.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::{Path, PathBuf};

use syn::visit::{self, Visit};

/// The floors, lowest first; rooms on one floor do not know each other.
const FLOORS: &[&[&str]] = &[
    &["expr"],
    &["image"],
    &["scene"],
    &["filter"],
    &["plan"],
    &["backend"],
    &["denoise", "tune"],
    &["evolve", "explain", "export", "report", "stress"],
    &["cli"],
];

fn floor(room: &str) -> Option<usize> {
    FLOORS.iter().position(|rooms| rooms.contains(&room))
}

/// A module as the names that lead to it from the crate's root.
type Module = Vec<String>;

/// Where the library's sources are, and those of the C library.
const LIBRARY: &str = "src";
const C_LIBRARY: &str = "capi/src";

/// Every module that has a file, with its file.
fn modules(sources: &str) -> BTreeMap<Module, PathBuf> {
    fn collect(folder: &Path, module: &[String], found: &mut BTreeMap<Module, PathBuf>) {
        for entry in fs::read_dir(folder).expect("src is readable") {
            let path = entry.expect("src is readable").path();
            let stem = path.file_stem().expect("a name").to_string_lossy().into_owned();
            let inner: Module = module.iter().cloned().chain([stem.clone()]).collect();
            if path.is_dir() {
                collect(&path, &inner, found);
            } else if path.extension().is_some_and(|e| e == "rs") {
                let module = if stem == "mod" { module.to_vec() } else { inner };
                found.insert(module, path);
            }
        }
    }
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join(sources);
    let mut found = BTreeMap::new();
    collect(&root, &[], &mut found);
    // These stand above all floors.
    found.remove(&vec!["lib".to_owned()]);
    found.remove(&vec!["main".to_owned()]);
    found
}

/// Everything that a file names by a path that begins at the crate's root or at a module
/// around it, tests left out.
struct Paths<'a> {
    module: &'a [String],
    found: BTreeSet<Vec<String>>,
}

impl Paths<'_> {
    /// A path's names, from the crate's root; `None` if it begins elsewhere.
    fn absolute(&self, path: &[String]) -> Option<Vec<String>> {
        let (first, rest) = path.split_first()?;
        let supers = path.iter().take_while(|name| *name == "super").count();
        match first.as_str() {
            "crate" => Some(rest.to_vec()),
            "self" => Some(self.module.iter().chain(rest).cloned().collect()),
            "super" => {
                let around = self.module.len().checked_sub(supers)?;
                Some(self.module[..around].iter().chain(&path[supers..]).cloned().collect())
            }
            _ => None,
        }
    }

    fn add(&mut self, path: &[String]) {
        let path = self.absolute(path);
        self.found.extend(path);
    }

    fn tree(&mut self, tree: &syn::UseTree, before: &[String]) {
        let with = |name: String| -> Vec<String> { before.iter().cloned().chain([name]).collect() };
        match tree {
            syn::UseTree::Path(path) => self.tree(&path.tree, &with(path.ident.to_string())),
            syn::UseTree::Group(group) => {
                group.items.iter().for_each(|item| self.tree(item, before));
            }
            syn::UseTree::Name(name) if name.ident == "self" => self.add(before),
            syn::UseTree::Name(name) => self.add(&with(name.ident.to_string())),
            syn::UseTree::Rename(rename) => self.add(&with(rename.ident.to_string())),
            syn::UseTree::Glob(_) => self.add(before),
        }
    }
}

fn is_test(attributes: &[syn::Attribute]) -> bool {
    attributes.iter().any(|attribute| {
        let list = attribute.meta.require_list();
        attribute.path().is_ident("cfg") && list.is_ok_and(|list| list.tokens.to_string() == "test")
    })
}

impl<'ast> Visit<'ast> for Paths<'_> {
    fn visit_item_use(&mut self, item: &'ast syn::ItemUse) {
        // What is only handed on is not known.
        if matches!(item.vis, syn::Visibility::Inherited) && !is_test(&item.attrs) {
            self.tree(&item.tree, &[]);
        }
    }

    fn visit_item_mod(&mut self, item: &'ast syn::ItemMod) {
        if !is_test(&item.attrs) {
            visit::visit_item_mod(self, item);
        }
    }

    fn visit_item_fn(&mut self, item: &'ast syn::ItemFn) {
        if !is_test(&item.attrs) {
            visit::visit_item_fn(self, item);
        }
    }

    fn visit_path(&mut self, path: &'ast syn::Path) {
        let names: Vec<String> = path.segments.iter().map(|s| s.ident.to_string()).collect();
        self.add(&names);
        visit::visit_path(self, path);
    }
}

/// By module: the modules whose files it names something of.
fn imports(sources: &str) -> BTreeMap<Module, BTreeSet<Module>> {
    let modules = modules(sources);
    let imports = modules.iter().map(|(module, file)| {
        let text = fs::read_to_string(file).expect("sources are readable");
        let syntax = syn::parse_file(&text).expect("sources are Rust");
        let mut paths = Paths { module, found: BTreeSet::new() };
        paths.visit_file(&syntax);
        let file = |path: Vec<String>| {
            let ends = (0..=path.len()).rev();
            ends.map(|end| path[..end].to_vec()).find(|module| modules.contains_key(module))
        };
        let others = paths.found.into_iter().filter_map(file).filter(|other| other != module);
        (module.clone(), others.collect())
    });
    imports.collect()
}

#[test]
fn imports_point_down() {
    let mut checked = 0;
    for (module, others) in imports(LIBRARY) {
        let room = &module[0];
        let own = floor(room).unwrap_or_else(|| panic!("`{room}` stands on no floor"));
        for other in others {
            let level = floor(&other[0]).unwrap_or_else(|| panic!("`{}` has no floor", other[0]));
            assert!(
                level < own || other[0] == *room,
                "{} (floor {own}) must not know {} (floor {level})",
                module.join("::"),
                other.join("::")
            );
            checked += 1;
        }
    }
    assert!(checked > 500, "only {checked} imports found: does this test still read the sources?");
}

/// The modules that one reaches by imports.
fn reached<'a>(
    imports: &'a BTreeMap<Module, BTreeSet<Module>>,
    from: &'a Module,
) -> BTreeSet<&'a Module> {
    let (mut reached, mut open) = (BTreeSet::new(), vec![from]);
    while let Some(module) = open.pop() {
        let next = imports.get(module).into_iter().flatten();
        open.extend(next.filter(|other| reached.insert(*other)));
    }
    reached
}

/// Modules that reach each other by imports, in groups.
fn circles(imports: &BTreeMap<Module, BTreeSet<Module>>) -> Vec<Vec<Module>> {
    let all: BTreeMap<&Module, BTreeSet<&Module>> =
        imports.keys().map(|module| (module, reached(imports, module))).collect();
    let mut circles: Vec<Vec<Module>> = Vec::new();
    for (module, reached) in &all {
        let known = circles.iter().flatten().any(|other| other == *module);
        if reached.contains(module) && !known {
            let circle = reached.iter().filter(|other| all[**other].contains(module));
            circles.push(circle.map(|other| (*other).clone()).collect());
        }
    }
    circles
}

#[test]
fn files_know_each_other_one_way() {
    let circles = [LIBRARY, C_LIBRARY].into_iter().flat_map(|sources| {
        let imports = imports(sources);
        assert!(imports.values().any(|others| !others.is_empty()), "{sources} is read");
        circles(&imports)
    });
    let names = |circle: &Vec<Module>| {
        circle.iter().map(|module| module.join("::")).collect::<Vec<_>>().join(", ")
    };
    let names: Vec<String> = circles.map(|circle| names(&circle)).collect();
    assert!(names.is_empty(), "circles of files:\n{}", names.join("\n"));
}
