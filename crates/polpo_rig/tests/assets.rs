//! The octopus that the demos and the dynamics' tests stand on is what the default recipe makes of its mesh.

use std::fs;
use std::path::Path;

use polpo_rig::{Recipe, build_rig, read_mesh};

#[test]
fn the_octopus_is_what_the_default_recipe_makes() {
    let assets = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../assets");
    let rig = build_rig(&read_mesh(&assets.join("octopus.glb")).expect("a mesh"), &Recipe::default()).expect("a rig");
    assert!(
        rig.to_postcard().expect("bytes") == fs::read(assets.join("octopus.rig")).expect("the rig"),
        "`cargo xtask assets` makes another one"
    );
}
