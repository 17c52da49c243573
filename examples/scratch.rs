use std::time::Instant;
use tamis::backend::*;
use tamis::expr::*;
use tamis::plan::*;
use tamis::scene::facts::Facts;
use tamis::scene::image::Image;
use tamis::scene::*;
fn main() {
    let args: Vec<String> = std::env::args().collect();
    let dir = &args[1];
    let path = format!("{dir}/4spp.exr");
    let scene = Scene::load(path.as_ref(), &Needs::everything(), 10, &LoadOptions::default()).unwrap();
    let reference = Image::load(format!("{dir}/reference.exr").as_ref()).unwrap();
    println!("{} {:?} {}", scene.name(), scene.layout(), scene.normalization());
    let m = metric::Metrics::of(&scene.noisy(), &reference).unwrap();
    println!("noisy {:.4}/{:.4}", m.rel_mse, m.trimmed_rel_mse);
    let jit = Jit::new().unwrap();
    for name in codebook::known().iter().map(|k| k.name) {
        let tree = codebook::named(name).unwrap().clone();
        let plan = Plan::new(&[tree], Window::dense(10), &Facts::of(&scene), Passes::ALL).unwrap();
        println!("{name}: tap {} pixel {} pair {} instrs signed {}", plan.tap().instrs().len(), plan.pixel().instrs().len(), plan.pair().instrs().len(), plan.signed());
        for b in [&Interpreter as &dyn Backend, &jit] {
            let t0 = Instant::now();
            let code = b.compile(&plan).unwrap();
            let tc = t0.elapsed();
            let mut best = f64::INFINITY;
            let mut out = None;
            for _ in 0..3 {
                let t = Instant::now();
                let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
                out = Some(pool.install(|| code.run(&scene, &[Rect::whole(&scene)]).unwrap()));
                best = best.min(t.elapsed().as_secs_f64());
            }
            let out = out.unwrap().swap_remove(0);
            let ch = |c: usize| out.pixels.iter().map(|p| p[c]).collect::<Vec<f32>>();
            let (w, h) = (scene.layout().width(), scene.layout().height());
            let img = Image::new("x", w, h, [ch(0), ch(1), ch(2)]).unwrap();
            let m = metric::Metrics::of(&img, &reference).unwrap();
            println!("  {:7} compile {:.2} ms run {:.2} ns/pair  relmse {:.4}/{:.4} kept {}", b.name(), tc.as_secs_f64() * 1e3, best * 1e9 / (w * h * 441) as f64, m.rel_mse, m.trimmed_rel_mse, out.kept);
        }
    }
}
