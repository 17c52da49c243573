//! Pages in a browser: whether their scripts run, draw and stay within the page.
//!
//! They need Chromium, and are shown as ignored where it is absent; with
//! `TAMIS_REQUIRE_BROWSER=1` in the environment its absence is a failure.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::{env, thread, time::Duration};

use libtest_mimic::{Arguments, Trial};
use serde_json::Value;

mod harness;
#[path = "cli/place.rs"]
#[allow(dead_code, reason = "the tests of the command line use all of it")]
mod place;

use harness::trial;
use place::{EDGE_AWARE, Place};

/// A name, and what is done in a browser.
type Case = (&'static str, fn(&Path));

const CASES: &[Case] = &[
    ("images_are_drawn_flipped_and_mapped", images_are_drawn_flipped_and_mapped),
    ("images_side_by_side_keep_to_one_place", images_side_by_side_keep_to_one_place),
    ("a_search_is_drawn_while_it_runs", a_search_is_drawn_while_it_runs),
    ("what_a_search_found_is_drawn_and_opens", what_a_search_found_is_drawn_and_opens),
];

fn main() {
    let browser = browser();
    let required = env::var_os("TAMIS_REQUIRE_BROWSER").is_some_and(|value| value != "0");
    let ignored = browser.is_none() && !required;
    let trials = CASES.iter().map(|&(name, check)| {
        let browser = browser.clone();
        trial(name.to_owned(), ignored, move || {
            check(browser.as_deref().expect("Chromium is installed: see scripts/test"));
        })
    });
    let trials: Vec<Trial> = trials.collect();
    libtest_mimic::run(&Arguments::from_args(), trials).exit();
}

/// Chromium, by whatever name it is installed.
fn browser() -> Option<PathBuf> {
    let folders: Vec<PathBuf> = env::split_paths(&env::var_os("PATH")?).collect();
    let names = ["chromium", "chromium-browser", "google-chrome", "chrome"];
    let all = names.iter().flat_map(|name| folders.iter().map(move |folder| folder.join(name)));
    all.into_iter().find(|path| path.is_file())
}

/// Listens for everything that goes wrong, before the page does anything.
const LISTEN: &str = "<head><script>
var problems = [];
addEventListener('error', (event) => problems.push(String(event.message)), true);
addEventListener('unhandledrejection', (event) => problems.push(String(event.reason)));
addEventListener('securitypolicyviolation', (event) => problems.push('fetches ' + event.blockedURI));
</script>";

/// Waits until the page says that it is done, does what a test wants, and tells what became of
/// it all.
const TELL: &str = "<script>
(async () => {
  const pause = () => new Promise((done) => setTimeout(done, 50));
  for (let k = 0; k < 200 && !document.body.dataset.state; k++) await pause();
  const inked = (canvas) => {
    const pixels = new Uint32Array(canvas.getContext('2d').getImageData(0, 0, canvas.width, canvas.height).data.buffer);
    return new Set(pixels).size;
  };
  const press = (key) => dispatchEvent(new KeyboardEvent('keydown', { key, bubbles: true }));
  const colors = (id) => inked(document.getElementById(id));
  const pixels = (id) => document.getElementById(id).toDataURL();
  let found = null;
  try { found = await (async () => { ACTIONS })(); } catch (error) { problems.push(String(error)); }
  await pause();
  const told = document.createElement('pre');
  told.id = 'told';
  told.textContent = JSON.stringify({
    state: document.body.dataset.state, problems, found,
    problem: document.getElementById('problem').textContent,
    canvases: [...document.querySelectorAll('canvas')].map((canvas) => [canvas.id, inked(canvas)]),
    fetched: performance.getEntriesByType('resource').map((entry) => entry.name).filter((name) => !name.startsWith('data:')),
  });
  document.body.append(told);
})();
</script></body>";

/// Opens a page, does something there, and returns what the page says of itself.
fn opened(browser: &Path, place: &Place, page: &str, actions: &str) -> Value {
    let html = String::from_utf8(place.bytes(page)).expect("UTF-8");
    let tell = TELL.replace("ACTIONS", actions);
    let probed = html.replacen("<head>", LISTEN, 1).replacen("</body>", &tell, 1);
    assert_ne!(probed.len(), html.len(), "a page has a head and a body");
    let copy = place.path("probed.html");
    fs::write(&copy, probed).expect("writable");
    let output = Command::new(browser)
        .args(["--headless=new", "--no-sandbox", "--disable-gpu", "--disable-dev-shm-usage"])
        .arg("--window-size=1280,1000")
        .arg(format!("--user-data-dir={}", place.path("profile").display()))
        .args(["--virtual-time-budget=60000", "--dump-dom"])
        .arg(format!("file://{}", copy.display()))
        .stdin(Stdio::null())
        .output()
        .expect("Chromium starts");
    let dom = String::from_utf8_lossy(&output.stdout);
    let start = "<pre id=\"told\">";
    let told = dom.split_once(start).and_then(|(_, rest)| rest.split_once("</pre>"));
    let (told, _) = told.unwrap_or_else(|| {
        panic!("the page told nothing: {}", String::from_utf8_lossy(&output.stderr))
    });
    let told = told.replace("&lt;", "<").replace("&gt;", ">").replace("&amp;", "&");
    let told: Value = serde_json::from_str(&told).expect("JSON");
    assert_eq!(told["state"], "ready", "{told}");
    assert_eq!(told["problems"].as_array().map(Vec::len), Some(0), "{told}");
    assert_eq!(told["problem"], "", "{told}");
    assert_eq!(told["fetched"].as_array().map(Vec::len), Some(0), "{told}");
    let canvases = told["canvases"].as_array().expect("a list");
    assert!(!canvases.is_empty(), "{told}");
    for canvas in canvases {
        assert!(canvas[1].as_u64() > Some(1), "{} is blank: {told}", canvas[0]);
    }
    told
}

/// Two images and their reference, and a page about them.
fn compared() -> Place {
    let place = Place::new();
    place.done(&["denoise", "room/4spp.exr", "-o", "clean.exr", "--filter", EDGE_AWARE]);
    let images = ["room/4spp.exr", "clean.exr", "room/reference.exr"];
    place.done(&[&["compare"], &images[..], &["--html", "page.html"]].concat());
    place
}

fn images_are_drawn_flipped_and_mapped(browser: &Path) {
    let place = compared();
    let actions = "
        const first = pixels('view');
        press('2'); const second = pixels('view');
        press('1'); const again = pixels('view');
        press('+'); const brighter = pixels('view');
        press('-'); press('e'); const relative = pixels('view');
        press('e'); const flip = pixels('view');
        press('e'); const back = pixels('view');
        document.querySelectorAll('[data-place]')[1].click();
        return [first === again, first === back,
            new Set([first, second, brighter, relative, flip]).size,
            document.querySelectorAll('#enlarged canvas').length,
            document.getElementById('place').textContent,
            document.querySelector('button.on').dataset.image];";
    let told = opened(browser, &place, "page.html", actions);
    let expected = serde_json::json!([true, true, 5, 3, "16 x 16 at (0, 0)", "1"]);
    for k in [0, 1, 2, 3, 5] {
        assert_eq!(told["found"][k], expected[k], "{told}");
    }
    let text = told["found"][4].as_str().expect("a text");
    assert!(text.starts_with("16 x 16 at ("), "{told}");
}

fn images_side_by_side_keep_to_one_place(browser: &Path) {
    let place = compared();
    // Three panels in two columns: what is drawn to the left of the first is drawn to the left of
    // the second, and dragging moves both.
    let actions = "
        press('s');
        const view = document.getElementById('view');
        const pen = view.getContext('2d');
        const panel = (k) => pen.getImageData(k * Math.floor(view.width / 2) + 1, 40, Math.floor(view.width / 2) - 2, 100).data;
        const edge = (k) => { const p = panel(k); let at = 0; while (at < p.length && p[at] === 0x33 && p[at + 1] === 0x33) at += 4; return at / 4; };
        const before = [edge(0), edge(1)];
        const box = view.getBoundingClientRect();
        const event = (type, x) => view.dispatchEvent(new PointerEvent(type, { pointerId: 1, clientX: box.left + x, clientY: box.top + 100, bubbles: true }));
        view.setPointerCapture = () => {};
        event('pointerdown', 100); event('pointermove', 60); event('pointerup', 60);
        return [before, [edge(0), edge(1)]];";
    let told = opened(browser, &place, "page.html", actions);
    let edge = |time: usize, panel: usize| told["found"][time][panel].as_u64().expect("a number");
    assert_eq!([edge(0, 0), edge(1, 0)], [edge(0, 1), edge(1, 1)], "{told}");
    assert_eq!(edge(0, 0), edge(1, 0) + 40, "{told}");
}

/// A search for programs of a few seconds.
const SEARCH: &[&str] = &[
    "evolve",
    "--scenes",
    "room",
    "--validate",
    "room",
    "--out",
    "out",
    "--population",
    "5",
    "--children",
    "5",
    "--tune-steps",
    "2",
    "--crop",
    "8",
    "--exam",
    "8",
    "--finish-steps",
    "3",
    "--interval",
    "1",
];

fn a_search_is_drawn_while_it_runs(browser: &Path) {
    let place = Place::new();
    let mut command = place.program(&[SEARCH, &["--generations", "100000"]].concat());
    let mut child = command.stdout(Stdio::null()).stderr(Stdio::null()).spawn().expect("it starts");
    let page = place.path("out/report.html");
    while !page.is_file() {
        assert!(child.try_wait().expect("a child").is_none(), "the search ended by itself");
        thread::sleep(Duration::from_millis(50));
    }
    let html = fs::read_to_string(&page).expect("a page appears whole");
    child.kill().expect("a child");
    child.wait().expect("a child");
    let reload = "<meta http-equiv=\"refresh\" content=\"10\">";
    assert!(html.contains(reload) && html.contains("The best so far"), "{}", &html[..2000]);
    // A page that loads itself again is never done.
    fs::write(place.path("page.html"), html.replace(reload, "")).expect("writable");
    let told = opened(browser, &place, "page.html", "return colors('course');");
    assert!(told["found"].as_u64() > Some(20), "{told}");
}

fn what_a_search_found_is_drawn_and_opens(browser: &Path) {
    let place = Place::new();
    place.done(&[SEARCH, &["--generations", "3"]].concat());
    let actions = "
        const chart = Chart.getChart('front');
        const open = () => document.querySelectorAll('details[open]').length;
        const before = open();
        const point = chart.getDatasetMeta(1).data[0];
        chart.options.onClick(null, [{ datasetIndex: 1, index: 0 }]);
        const slide = document.querySelector('.slide');
        slide.nextElementSibling.value = 80;
        slide.nextElementSibling.dispatchEvent(new Event('input'));
        return [open() - before, document.querySelector('details[open]').textContent,
            slide.style.getPropertyValue('--at'), document.querySelectorAll('.graph svg rect').length,
            [...document.images].filter((image) => image.naturalWidth === 0).length,
            Number.isFinite(point.x), chart.data.datasets[0].data.length];";
    let told = opened(browser, &place, "out/report.html", actions);
    let found = &told["found"];
    assert!(found[0] == 1 && found[2] == "80%" && found[4] == 0, "{told}");
    assert!(found[1].as_str().is_some_and(|text| text.starts_with("best: score")), "{told}");
    assert!(found[3].as_u64() > Some(0) && found[5] == true, "{told}");
    let front = fs::read_dir(place.path("out/front")).expect("a folder").count();
    assert_eq!(found[6], front, "{told}");
}
