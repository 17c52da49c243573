//! Gives the shared library the name that programs ask for when they start.

fn main() {
    println!("cargo::rerun-if-changed=build.rs");
    let variable = |name: &str| std::env::var(name).expect("cargo sets it");
    let (major, minor) = (variable("CARGO_PKG_VERSION_MAJOR"), variable("CARGO_PKG_VERSION_MINOR"));
    // Before version 1 every minor version may change functions.
    let version = if major == "0" { format!("{major}.{minor}") } else { major };
    let argument = match variable("CARGO_CFG_TARGET_OS").as_str() {
        "windows" => return,
        "macos" => format!("-Wl,-install_name,@rpath/libtamis.{version}.dylib"),
        _ => format!("-Wl,-soname,libtamis.so.{version}"),
    };
    println!("cargo::rustc-cdylib-link-arg={argument}");
}
