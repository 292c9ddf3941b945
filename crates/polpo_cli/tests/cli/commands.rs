//! The commands as one types them: exit codes, reports, JSON, pictures, and what is refused.

use std::process::{Command, Stdio};

use crate::common::{Folder, json, polpo, refused, text};

#[test]
fn a_mesh_is_rigged_and_the_report_is_true() {
    let folder = Folder::new("rigged");
    let block = folder.block();
    let output = polpo(&["rig", &block, "--particles", "40", "--edges-per-particle", "3", "--json", "-"]);
    assert_eq!(output.status.code(), Some(0), "{}", text(&output.stderr));
    assert!(output.stderr.is_empty(), "progress is for terminals");
    let report = json(&output);
    let rig = polpo_rig::Rig::read(folder.at("block.rig")).expect("it is there, beside the mesh");
    assert_eq!(
        (rig.particles.len(), rig.edges.len(), rig.skin.len()),
        (40, 120, report["mesh"]["vertices"].as_u64().expect("a number") as usize)
    );
    assert_eq!(report["rig"]["particles"], 40);
    assert_eq!(report["rig"]["edges"], 120);
    assert_eq!(report["rig"]["pieces"], 1);
    assert_eq!(report["mesh"]["triangles"], 12);
    let near = |value: &serde_json::Value, exact: f64| (value.as_f64().expect("a number") / exact - 1.0).abs() < 1e-4;
    assert!(near(&report["rig"]["mass_kg"], 125.0), "{report}");
    assert!(near(&report["mesh"]["volume_m3"], 0.125), "{report}");
    assert_eq!(report["mesh"]["size_m"], serde_json::json!([1.0, 0.5, 0.25]));
    assert_eq!(report["written"], folder.at("block.rig"));
    assert_eq!(report["stages_s"].as_array().map(Vec::len), Some(6));

    // For people, and the same bytes again.
    let first = std::fs::read(folder.at("block.rig")).expect("there");
    let output = polpo(&["rig", &block, "--particles", "40", "--edges-per-particle", "3"]);
    let report = text(&output.stdout);
    assert!(report.contains("particles  40, 125 kg") && report.contains("edges      120, 3.00 a particle"), "{report}");
    assert!(report.ends_with(&format!("written    {}\n", folder.at("block.rig"))), "{report}");
    assert!(std::fs::read(folder.at("block.rig")).expect("there") == first, "the same mesh and recipe give the same bytes");
    assert!(polpo(&["rig", &block, "--particles", "9", "--quiet"]).stdout.is_empty());
}

#[test]
fn the_recipe_beside_the_mesh_is_used_and_options_override_it() {
    let folder = Folder::new("recipe");
    let block = folder.block();
    let own = folder.write("block.rig.toml", "particles = 20\ndensity = 500.0\n");
    let output = polpo(&["rig", &block, "--dry-run", "--json", "-"]);
    let report = json(&output);
    assert_eq!(
        (&report["rig"]["particles"], &report["recipe"], &report["written"]),
        (&20.into(), &own.clone().into(), &serde_json::Value::Null)
    );
    assert!((report["rig"]["mass_kg"].as_f64().expect("a number") / 62.5 - 1.0).abs() < 1e-4);
    assert!(!std::path::Path::new(&folder.at("block.rig")).exists());
    assert!(text(&polpo(&["rig", &block, "--dry-run"]).stdout).contains(&format!("recipe     {own}")));

    let recipe = folder.at("used.toml");
    let output =
        polpo(&["rig", &block, "--particles", "30", "-o", &folder.at("b.rig.ron"), &format!("--write-recipe={recipe}"), "--json", "-"]);
    assert_eq!(json(&output)["rig"]["particles"], 30);
    let used = polpo_rig::Recipe::read(&recipe).expect("a recipe");
    assert_eq!((used.amount, used.density), (polpo_rig::Amount::Particles(30), 500.0));
    let again = polpo(&["rig", &block, "--recipe", &recipe, "-o", &folder.at("c.rig.ron")]);
    assert_eq!(again.status.code(), Some(0));
    let read = |name: &str| std::fs::read(folder.at(name)).expect("written");
    assert!(read("b.rig.ron") == read("c.rig.ron"));
}

#[test]
fn a_rig_is_inspected() {
    let folder = Folder::new("inspected");
    let block = folder.block();
    let alone = json(&polpo(&["inspect", &block, "--json", "-"]));
    assert_eq!((&alone["rig"], &alone["mesh"]["triangles"]), (&serde_json::Value::Null, &12.into()));
    assert_eq!(polpo(&["rig", &block, "--particles", "30"]).status.code(), Some(0));
    let (rig, png, file) = (folder.at("block.rig"), folder.at("block.png"), folder.at("block.json"));
    let output = polpo(&["inspect", &rig, "--png", &png, "--json", &file]);
    assert_eq!(output.status.code(), Some(0), "{}", text(&output.stderr));
    assert!(text(&output.stdout).contains("the rig keeps its rules and is one of this mesh"));
    let report: serde_json::Value = serde_json::from_slice(&std::fs::read(file).expect("written")).expect("JSON");
    assert_eq!((&report["rig"]["particles"], &report["whole"]), (&30.into(), &true.into()));
    let picture = image::open(png).expect("a picture").into_rgb8();
    assert_eq!(picture.dimensions(), (1600, 1200));
    // Something is drawn in each quarter, which has colours: a backdrop has none.
    for (left, top) in [(0, 0), (800, 0), (0, 600), (800, 600)] {
        let places = (left..left + 800).flat_map(|x| (top..top + 600).map(move |y| (x, y)));
        let is_coloured = |&(x, y): &(u32, u32)| {
            let [r, g, b] = picture.get_pixel(x, y).0;
            r.max(g).max(b) - r.min(g).min(b) > 30
        };
        let coloured = places.filter(is_coloured).count();
        assert!(coloured > 5_000, "{coloured} pixels of the quarter at {left}, {top}");
    }
    // In pieces: a rig without edges.
    let mut broken = polpo_rig::Rig::read(&rig).expect("a rig");
    broken.edges.clear();
    broken.write(&rig).expect("written");
    let output = polpo(&["inspect", &rig]);
    assert_eq!(output.status.code(), Some(1));
    assert!(text(&output.stdout).contains("IN 30 PIECES"));
}

#[test]
fn a_body_falls_and_rests() {
    let folder = Folder::new("fallen");
    let block = folder.block();
    let fall = ["simulate", &block, "--particles", "30", "--seconds", "2", "--size", "0.5", "--height", "0.1", "--threads", "2"];
    let png = folder.at("block.png");
    let output = polpo(&[&fall[..], &["--json", "-", "--png", &png]].concat());
    assert_eq!(output.status.code(), Some(0), "{} {}", text(&output.stdout), text(&output.stderr));
    let report = json(&output);
    let number = |key: &str| report[key].as_f64().unwrap_or_else(|| panic!("{key} of {report}"));
    assert_eq!((&report["particles"], &report["steps"], &report["finite"]), (&30.into(), &120.into(), &true.into()));
    assert!((number("mass_kg") / 15.625 - 1.0).abs() < 1e-4 && number("size_m") == 0.5 && number("scale") == 0.5);
    assert!((0.12..0.31).contains(&number("height_m")), "it stands or lies: {report}");
    assert!(number("penetration_m") < 0.005 && number("edge_strain") < 0.5 && number("speed_m_s") < 0.1, "{report}");
    assert!(number("step_ms_best") > 0.0 && number("step_ms_best") <= number("step_ms_median"));
    assert_eq!(image::open(png).expect("a picture").into_rgb8().dimensions(), (1600, 700));
    // Nothing was written beside the mesh, and another run on another number of threads ends in the same state.
    assert!(!std::path::Path::new(&folder.at("block.rig")).exists());
    let again = json(&polpo(&[
        "simulate",
        &block,
        "--particles",
        "30",
        "--seconds",
        "2",
        "--size",
        "0.5",
        "--height",
        "0.1",
        "--threads",
        "1",
        "--json",
        "-",
    ]));
    assert_eq!(again["state_hash"], report["state_hash"]);
    let report = polpo(&["simulate", &block, "--particles", "30", "--seconds", "0.1", "--count", "2"]);
    assert!(text(&report.stdout).contains("scene      2 bodies of 30 particles, 125 kg, 1.00 m"), "{}", text(&report.stdout));
}

#[test]
fn a_failed_check_is_exit_code_1() {
    let folder = Folder::new("failed");
    let block = folder.block();
    // A jelly of 0.2 Hz is flat on the floor.
    let output = polpo(&["simulate", &block, "--particles", "30", "--seconds", "3", "--hertz", "0.05", "--height", "5"]);
    assert_eq!(output.status.code(), Some(1), "{}", text(&output.stdout));
    assert!(text(&output.stdout).contains("FAULT      an edge was "), "{}", text(&output.stdout));
}

#[test]
fn a_rig_with_a_material_asks_for_its_substeps() {
    let folder = Folder::new("material");
    // A bar of two cells of 0.1 m.
    let particle = |x: f32| polpo_rig::Particle {
        position: glam::Vec3::X * x,
        frame: glam::Quat::IDENTITY,
        radii: glam::Vec3::splat(0.05),
        mass: 1.0,
    };
    let moment = 0.01f32 * 0.01 / 12.0;
    let facet = polpo_rig::Facet {
        pair: [0, 1],
        area: glam::Vec3::X * 0.01,
        centroid: glam::Vec3::X * 0.05,
        moments: [0.0, moment, moment, 0.0, 0.0, 0.0],
    };
    let material =
        polpo_rig::RecipeMaterial { youngs_modulus: 1e6, poissons_ratio: 0.0, retardation: 0.0, fidelity: polpo_rig::Fidelity::Cells };
    let rig = polpo_rig::Rig {
        particles: vec![particle(0.0), particle(0.1)],
        edges: vec![[0, 1]],
        cells: Some(polpo_rig::Cells { material, volumes: vec![1e-3; 2], facets: vec![facet], limb: None }),
        ..polpo_rig::Rig::default()
    };
    let path = folder.at("bar.rig");
    rig.write(&path).expect("written");
    let needed = |more: &[&str]| {
        let output = polpo(&[&["simulate", path.as_str(), "--seconds", "0.1", "--json", "-"], more].concat());
        json(&output)["substeps_needed"].as_u64().unwrap_or_else(|| panic!("{} {}", text(&output.stdout), text(&output.stderr)))
    };
    let (soft, stiff) = (needed(&["--size", "0.2"]), needed(&["--size", "0.2", "--youngs-modulus", "1e8"]));
    // Frequencies grow with the root of Young's modulus.
    assert!(soft > 1 && stiff.abs_diff(10 * soft) <= 10, "{soft}, {stiff}");
    // Twice the size: half the frequency.
    assert!(needed(&["--size", "0.4"]).abs_diff(soft / 2) <= 1);
    let block = folder.block();
    let made = polpo(&["simulate", &block, "--particles", "9", "--youngs-modulus", "1e5", "--seconds", "0.1", "--json", "-"]);
    assert!(json(&made)["substeps_needed"].is_u64(), "{}", text(&made.stderr));
    assert_eq!(polpo(&["rig", &block, "--particles", "9"]).status.code(), Some(0));
    refused(&polpo(&["simulate", &folder.at("block.rig"), "--youngs-modulus", "1e5"]), "the rig has no cells");
}

#[test]
fn bad_input_is_named() {
    let folder = Folder::new("bad");
    let block = folder.block();
    for command in ["rig", "inspect", "simulate"] {
        refused(&polpo(&[command, &folder.at("none.glb")]), "none.glb: cannot be read: ");
        refused(&polpo(&[command, &folder.write("text.glb", "no mesh")]), "text.glb: not a readable mesh");
    }
    refused(&polpo(&["inspect", &folder.write("bad.rig", "no rig")]), "bad.rig: not a rig: it does not start with POLPORIG");
    refused(
        &polpo(&["rig", &block, "--recipe", &folder.write("bad.toml", "particles = 3\n\nspaceing = 2.0\n")]),
        "bad.toml: not a recipe: TOML parse error at line 3, column 1",
    );
    refused(&polpo(&["rig", &block, "--recipe", &folder.at("none.toml")]), "none.toml: ");
    refused(&polpo(&["rig", &block, "--particles", "0"]), "setting `particles` is 0: 1 to 100000");
    refused(&polpo(&["rig", &block, "-o", &folder.at("a.txt")]), "extension \"txt\" is not a rig format");
    refused(&polpo(&["rig", &block, "-o", &folder.at("no/folder/a.rig"), "--particles", "9"]), "no/folder/a.rig: ");
    refused(&polpo(&["rig", &block, "--poissons-ratio", "0.3"]), "a material needs --youngs-modulus");
    let output = polpo(&["rig", &block, "--particles", "3", "--spacing", "0.1"]);
    assert_eq!(output.status.code(), Some(2));
    assert!(text(&output.stderr).contains("'--particles <N>' cannot be used with '--spacing <D>'"), "{}", text(&output.stderr));
    // A rig of another mesh, and one whose mesh is gone.
    assert_eq!(polpo(&["rig", &block, "--particles", "9"]).status.code(), Some(0));
    let rig = folder.at("block.rig");
    let other = folder.write("other.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n");
    refused(&polpo(&["inspect", &rig, "--mesh", &other]), "vertices, the rig skins");
    refused(&polpo(&["inspect", &block, "--png", &folder.at("no/folder/a.png")]), "no/folder/a.png: no picture was written: ");
    std::fs::remove_file(&block).expect("it can go");
    refused(&polpo(&["inspect", &rig, "--png", &folder.at("a.png")]), "its mesh is not beside it");
    assert_eq!(polpo(&["simulate"]).status.code(), Some(2));
}

#[test]
fn a_closed_pipe_is_no_trouble() {
    let folder = Folder::new("pipe");
    let block = folder.block();
    for arguments in [vec!["completions", "bash"], vec!["inspect", &block], vec!["simulate", "--references", "--only", "throw"]] {
        let mut child = Command::new(env!("CARGO_BIN_EXE_polpo"))
            .args(&arguments)
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn()
            .expect("it starts");
        drop(child.stdout.take());
        let output = child.wait_with_output().expect("it ends");
        assert_eq!((output.status.code(), text(&output.stderr)), (Some(0), ""), "{arguments:?}");
    }
}

#[test]
fn shells_complete_the_commands() {
    for (shell, mark) in [("bash", "complete -F _polpo"), ("zsh", "#compdef polpo"), ("fish", "complete -c polpo")] {
        let output = polpo(&["completions", shell]);
        assert_eq!(output.status.code(), Some(0));
        let script = text(&output.stdout);
        assert!(script.contains(mark), "{shell}: {script}");
        assert!(
            ["rig", "inspect", "simulate", "completions", "write-recipe"].iter().all(|word| script.contains(word)),
            "{shell}: {script}"
        );
    }
    assert_eq!(polpo(&["completions", "abacus"]).status.code(), Some(2));
}

#[test]
fn help_tells_the_exit_codes() {
    for command in [&["--help"][..], &["rig", "--help"], &["inspect", "--help"], &["simulate", "--help"]] {
        assert!(text(&polpo(command).stdout).contains("Exit codes: 0 "), "{command:?}");
    }
}
