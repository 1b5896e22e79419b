//! Scene files, meshes and clouds. Each file is read correctly, or refused with one message.

use std::fmt::Write as _;
use std::fs;
use std::path::Path;

use growbot_core::path::Segment;
use growbot_core::pose::Pose;
use growbot_core::random::Rng;
use growbot_scene::clearance::RequiredClearance;
use growbot_scene::path_clearance::{clearance, is_path_clear};
use growbot_scene::read::{FormatError, ReadError, geometry};
use growbot_scene::scene_file::{SceneError, load, parse};
use nalgebra::Vector3;
use tempfile::TempDir;

const SCENE: &str = r#"
format = "growbot-scene/1"
margin_mm = 5.0
[[box]]
center_mm = [100.0, 0.0, 200.0]
size_mm = [50, 60.0, 70.0]
rpy_deg = [0, 0, 90]
[[ball]]
center_mm = [0, 300, 0]
radius_mm = 40
[[capsule]]
from_mm = [0, 0, 500]
to_mm = [100, 0, 500]
radius_mm = 10
[[halfspace]]
point_mm = [0, 0, -50]
normal = [0, 0, 2]
[[mesh]]
file = "cube.stl"
scale = 1000
[[points]]
file = "scan.ply"
radius_mm = 0.6
"#;

/// Returns the corners of a cube of side 2 round a point, and its faces, counter-clockwise from outside.
fn cube(centre: [f64; 3]) -> (Vec<[f64; 3]>, Vec<[usize; 4]>) {
    let corner = |i: usize| [0, 1, 2].map(|axis| centre[axis] + if i >> axis & 1 == 1 { 1.0 } else { -1.0 });
    let faces = vec![[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
    ((0..8).map(corner).collect(), faces)
}

fn stl_text() -> String {
    let (corners, faces) = cube([3.0, 0.0, 0.0]);
    let mut text = "solid cube\n".to_owned();
    for [a, b, c, d] in faces {
        for triangle in [[a, b, c], [a, c, d]] {
            text += "facet normal 0 0 0\nouter loop\n";
            for [x, y, z] in triangle.map(|corner| corners[corner]) {
                let _ = writeln!(text, "vertex {x} {y} {z}");
            }
            text += "endloop\nendfacet\n";
        }
    }
    text + "endsolid cube\n"
}

fn stl_binary() -> Vec<u8> {
    let (corners, faces) = cube([3.0, 0.0, 0.0]);
    let mut bytes = vec![b's'; 80];
    bytes.extend(12_u32.to_le_bytes());
    for [a, b, c, d] in faces {
        for triangle in [[a, b, c], [a, c, d]] {
            bytes.extend([0; 12]);
            bytes.extend(triangle.iter().flat_map(|i| corners[*i]).flat_map(|value| (value as f32).to_le_bytes()));
            bytes.extend([0; 2]);
        }
    }
    bytes
}

fn obj() -> String {
    let (corners, faces) = cube([3.0, 0.0, 0.0]);
    let mut text = "# a cube\no cube\n".to_owned();
    for [x, y, z] in corners {
        let _ = writeln!(text, "v {x} {y} {z}");
    }
    for [a, b, c, d] in faces {
        // Indices count from 1, or back from the end.
        let _ = writeln!(text, "f {}/1/1 {}//2 {} {}", a + 1, b + 1, c + 1, d as i32 - 8);
    }
    text
}

fn ply() -> String {
    let (corners, faces) = cube([3.0, 0.0, 0.0]);
    let mut text = "ply\nformat ascii 1.0\nelement vertex 8\nproperty double x\nproperty double y\nproperty double z\n\
                    element face 6\nproperty list uchar int vertex_indices\nend_header\n"
        .to_owned();
    for [x, y, z] in corners {
        let _ = writeln!(text, "{x} {y} {z}");
    }
    for [a, b, c, d] in faces {
        let _ = writeln!(text, "4 {a} {b} {c} {d}");
    }
    text
}

/// Returns a GLB file with a cube round the origin, in a node that moves the cube, below a node that scales millimetres
/// to metres.
fn glb() -> Vec<u8> {
    glb_with("", "")
}

/// Like [`glb`], but with a part of its JSON replaced.
fn glb_with(from: &str, to: &str) -> Vec<u8> {
    let (corners, faces) = cube([0.0, 0.0, 0.0]);
    let mut data: Vec<u8> = corners.iter().flatten().flat_map(|value| (*value as f32).to_le_bytes()).collect();
    for [a, b, c, d] in faces {
        data.extend([a, b, c, a, c, d].iter().flat_map(|index| (*index as u16).to_le_bytes()));
    }
    let json = r#"{"asset":{"version":"2.0"},"scene":0,"scenes":[{"nodes":[0]}],
        "nodes":[{"scale":[0.001,0.001,0.001],"children":[1]},{"translation":[3,0,0],"mesh":0}],
        "meshes":[{"primitives":[{"attributes":{"POSITION":0},"indices":1}]}],
        "accessors":[{"bufferView":0,"componentType":5126,"count":8,"type":"VEC3"},
                     {"bufferView":1,"componentType":5123,"count":36,"type":"SCALAR"}],
        "bufferViews":[{"buffer":0,"byteLength":96},{"buffer":0,"byteOffset":96,"byteLength":72}],
        "buffers":[{"byteLength":168}]}"#;
    assert!(json.contains(from), "{from}");
    let json = json.replacen(from, to, 1);
    let json = format!("{json:<width$}", width = json.len().next_multiple_of(4));
    let mut bytes = b"glTF".to_vec();
    let words = [2, (28 + json.len() + data.len()) as u32, json.len() as u32, 0x4e4f_534a];
    bytes.extend(words.iter().flat_map(|word| word.to_le_bytes()));
    bytes.extend(json.bytes());
    bytes.extend([data.len() as u32, 0x004e_4942].iter().flat_map(|word| word.to_le_bytes()));
    bytes.extend(data);
    bytes
}

fn pcd(binary: bool) -> Vec<u8> {
    let mut bytes = b"# .PCD v0.7\nVERSION 0.7\nFIELDS x y z intensity\nSIZE 4 4 4 4\nTYPE F F F F\nCOUNT 1 1 1 1\n\
                      WIDTH 2\nHEIGHT 1\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS 2\n"
        .to_vec();
    if binary {
        bytes.extend(b"DATA binary\n");
        bytes.extend([1.0_f32, 2.0, 3.0, 9.0, 4.0, 5.0, 6.0, 9.0].iter().flat_map(|value| value.to_le_bytes()));
    } else {
        bytes.extend(b"DATA ascii\n1 2 3 9\n4 5 6 9\n");
    }
    bytes
}

fn scan() -> &'static str {
    "ply\nformat ascii 1.0\nelement vertex 2\nproperty float x\nproperty float y\nproperty float z\nend_header\n\
     900 0 0\n0 900 0\n"
}

fn directory() -> TempDir {
    let directory = tempfile::tempdir().unwrap();
    fs::write(directory.path().join("scene.toml"), SCENE).unwrap();
    fs::write(directory.path().join("cube.stl"), stl_binary()).unwrap();
    fs::write(directory.path().join("scan.ply"), scan()).unwrap();
    directory
}

fn written(name: &str, bytes: impl AsRef<[u8]>) -> (TempDir, std::path::PathBuf) {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join(name);
    fs::write(&path, bytes).unwrap();
    (directory, path)
}

#[test]
fn a_scene_contains_everything_in_its_file() {
    let directory = directory();
    let loaded = load(&directory.path().join("scene.toml")).unwrap();
    assert_eq!((loaded.margin, loaded.scene.len()), (Some(5.0), 4 + 12 + 2));
    let distance = |x: f64, y: f64, z: f64| loaded.scene.distance(&Vector3::new(x, y, z));
    // The box is turned: 60 mm along x. The mesh is a cube of 2 m round x = 3 m.
    assert!((distance(135.0, 0.0, 200.0) - 5.0).abs() < 1e-9);
    assert!((distance(0.0, 300.0, 50.0) - 10.0).abs() < 1e-9);
    assert!((distance(50.0, 0.0, 530.0) - 20.0).abs() < 1e-9);
    assert!((distance(0.0, 0.0, -45.0) - 5.0).abs() < 1e-9);
    assert!((distance(1990.0, 0.0, 500.0) - 10.0).abs() < 1e-9);
    assert!(distance(3000.0, 0.0, 500.0) < -400.0);
    assert!((distance(900.0, 0.0, 3.0) - 2.4).abs() < 1e-9);
    // Another mesh makes another scene.
    fs::write(directory.path().join("cube.stl"), stl_text()).unwrap();
    assert_ne!(load(&directory.path().join("scene.toml")).unwrap().hash, loaded.hash);
}

#[test]
fn every_format_gives_the_same_cube() {
    let files: [(&str, Vec<u8>); 5] = [
        ("cube.stl", stl_text().into()),
        ("cube.STL", stl_binary()),
        ("cube.obj", obj().into()),
        ("cube.ply", ply().into()),
        ("cube.glb", glb()),
    ];
    for (name, bytes) in files {
        let (_directory, path) = written(name, bytes);
        let loaded = load(&path).unwrap_or_else(|error| panic!("{name}: {error}"));
        assert_eq!(loaded.scene.len(), 12, "{name}");
        for (x, distance) in [(3.0, -1.0), (6.0, 2.0)] {
            let found = loaded.scene.distance(&Vector3::new(x, 0.0, 0.0));
            assert!((found - distance).abs() < 1e-9, "{name}: {found}");
        }
    }
    for binary in [false, true] {
        let (_directory, path) = written("scan.pcd", pcd(binary));
        let points = geometry(&path).unwrap().geometry.points;
        assert_eq!(points, [Vector3::new(1.0, 2.0, 3.0), Vector3::new(4.0, 5.0, 6.0)]);
    }
}

#[test]
fn a_glb_is_read_in_metres_with_y_up() {
    // Half a turn about glTF's x axis turns the cube of side 2, which is moved in the axes of the node above it.
    let node = r#""translation":[100,200,300],"rotation":[1,0,0,0],"scale":[1,20,5]"#;
    let (_directory, path) = written("part.glb", glb_with(r#""translation":[3,0,0]"#, node));
    let bounds = load(&path).unwrap().scene.bounds();
    let expected = [Vector3::new(99.0, -305.0, 180.0), Vector3::new(101.0, -295.0, 220.0)];
    for (found, expected) in [bounds.min, bounds.max].iter().zip(expected) {
        assert!((found - expected).amax() < 1e-4, "{bounds:?}");
    }
    // A scene file may give another length of a unit. The axes remain those of glTF.
    let scene = path.with_file_name("scene.toml");
    let entry = "format = \"growbot-scene/1\"\n[[mesh]]\nfile = \"part.glb\"\n";
    for (scale, unit) in [("", 1000.0), ("scale = 25.4\n", 25.4)] {
        fs::write(&scene, format!("{entry}{scale}")).unwrap();
        let bounds = load(&scene).unwrap().scene.bounds();
        assert!((bounds.max - expected[1] * (unit / 1000.0)).amax() < 1e-4, "{bounds:?}");
    }
}

#[test]
fn an_open_mesh_is_not_a_solid() {
    let open = obj().replacen("f 1/1/1", "# ", 1);
    let (directory, path) = written("open.obj", &open);
    let refusal = load(&path).unwrap_err();
    assert!(matches!(refusal, SceneError::OpenMesh { open: 4, .. }), "{refusal}");
    let scene = "format = \"growbot-scene/1\"\n[[mesh]]\nfile = \"open.obj\"\nsolid = false\n";
    let path = directory.path().join("scene.toml");
    fs::write(&path, scene).unwrap();
    assert!(load(&path).unwrap().scene.distance(&Vector3::new(3.0, 0.0, 0.0)) > 0.999);
}

#[test]
fn a_mesh_with_an_inverted_face_is_not_a_solid() {
    let wedge = "v 0 0 0\nv 100 0 0\nv 0 100 0\nv 0 0 100\nf 1 3 2\nf 1 2 4\nf 2 3 4\nf 1 4 3\n";
    let (_directory, path) = written("wedge.obj", wedge);
    assert!(load(&path).is_ok());
    let (_directory, path) = written("flipped.obj", wedge.replace("f 2 3 4", "f 4 3 2"));
    let refusal = load(&path).unwrap_err();
    assert!(matches!(refusal, SceneError::FlippedFaces { flipped: 3, .. }), "{refusal}");
    let message = refusal.to_string();
    assert!(
        message.contains("3 edges") && message.contains("inside out") && message.contains("solid = false"),
        "{message}"
    );
    // If all faces are inside out, they enclose the same volume.
    let (_directory, path) =
        written("outside.obj", "v 0 0 0\nv 100 0 0\nv 0 100 0\nv 0 0 100\nf 2 3 1\nf 4 2 1\nf 4 3 2\nf 3 4 1\n");
    assert!(load(&path).unwrap().scene.contains(&Vector3::new(10.0, 10.0, 10.0)));
}

#[test]
fn errors_are_reported_with_value_and_limit() {
    let refused = |from: &str, to: &str| {
        assert!(SCENE.contains(from), "{from}");
        parse(&SCENE.replacen(from, to, 1), "scene.toml").unwrap_err().to_string()
    };
    for (from, to, words) in [
        ("scene/1", "scene/2", "format \"growbot-scene/2\""),
        ("radius_mm = 40", "radius_mm = -1", "radius_mm of [[ball]] 1 is -1, but it must be above 0"),
        ("margin_mm = 5.0", "margin_mm = nan", "margin_mm is NaN"),
        ("[0, 300, 0]", "[0, 1e9, 0]", "center_mm of [[ball]] 1 is 1000000000"),
        ("normal = [0, 0, 2]", "normal = [0, 0, 0]", "normal of [[halfspace]] 1"),
        ("scale = 1000", "scale = inf", "scale of cube.stl is inf"),
        ("[[ball]]", "[[bowl]]", "unknown field `bowl`"),
        ("size_mm = [50, 60.0, 70.0]", "size_mm = [50, 60.0]", "line 6"),
        ("radius_mm = 10", "radius_mm = \"10\"", "invalid type"),
    ] {
        let message = refused(from, to);
        assert!(message.contains(words) && !message.contains('\n'), "{message}");
    }
    assert!(matches!(load(Path::new("no-such-scene.toml")), Err(SceneError::Read(ReadError::Unreadable { .. }))));
    let (_directory, path) = written("nan.ply", scan().replace("900 0 0", "nan 0 0"));
    let message = load(&path).unwrap_err().to_string();
    assert!(message.starts_with("cannot parse ") && message.contains("nan.ply: "), "{message}");
    let (_directory, path) = written("empty.obj", "");
    assert!(matches!(load(&path), Err(SceneError::Empty { what: "points", .. })));
}

#[test]
fn unsupported_features_are_refused() {
    for (from, to, words) in [
        (r#""indices":1}"#, r#""indices":1,"mode":5}"#, "mode 5"),
        (r#""type":"SCALAR"}"#, r#""type":"SCALAR","sparse":{}}"#, "accessor 1 is sparse"),
        (r#"{"buffer":0,"byteLength":96}"#, r#"{"buffer":1,"byteLength":96}"#, "in buffer 1"),
        (r#""asset""#, r#""extensionsRequired":["KHR_draco"],"asset""#, "KHR_draco"),
    ] {
        let message = load(&written("part.glb", glb_with(from, to)).1).unwrap_err().to_string();
        assert!(message.contains(words), "{message}");
    }
    let strips = scan()
        .replace("end_header\n", "element tristrips 1\nproperty list int int vertex_indices\nend_header\n")
        + "3 0 1 0\n";
    let (_directory, path) = written("strips.ply", strips);
    let SceneError::Read(ReadError::Malformed { error, .. }) = load(&path).unwrap_err() else { panic!() };
    assert!(matches!(error, FormatError::Strips) && error.to_string().contains("strips of triangles"));
    // A comment may contain any bytes. It must not make the reader lose a face.
    let mut bytes = obj().into_bytes();
    bytes.extend(b"# W\xe4nde\n");
    let (_directory, path) = written("remark.obj", &bytes);
    assert!(load(&path).is_ok());
    let at = bytes.windows(2).position(|pair| pair == b"f ").unwrap() + 2;
    bytes[at] = 0xe4;
    let (_directory, path) = written("spoilt.obj", &bytes);
    assert!(load(&path).is_err());
}

#[test]
fn a_body_starting_inside_a_solid_is_not_clear() {
    let (_directory, path) = written(
        "scene.toml",
        "format = \"growbot-scene/1\"\nmargin_mm = 5\n[[mesh]]\nfile = \"cube.stl\"\nscale = 5000\n",
    );
    fs::write(path.with_file_name("cube.stl"), stl_binary()).unwrap();
    let scene = load(&path).unwrap().scene;
    let path = [Segment::Straight { length: 500.0 }];
    let need = RequiredClearance { distance: 28.0, tolerance: 0.1 };
    let from = |x: f64| Pose::from_degrees([x, 0.0, 0.0, 0.0, 90.0]).unwrap().frame();
    // The cube extends from 10 m to 20 m.
    assert!(is_path_clear(&scene, &path, &from(0.0), &need) && clearance(&scene, &path, &from(0.0)).distance > 9999.0);
    assert!(!is_path_clear(&scene, &path, &from(15_000.0), &need));
    assert!(clearance(&scene, &path, &from(15_000.0)).distance < -4999.0);
}

/// Changes some bytes, or cuts, duplicates or drops a range of them.
fn mutate(bytes: &mut Vec<u8>, random: &mut Rng) {
    for _ in 0..=random.below(4) {
        let at = random.below(bytes.len() as u64 + 1) as usize;
        let length = (random.below(40) as usize).min(bytes.len() - at);
        match random.below(6) {
            0 => bytes.truncate(at),
            1 => drop(bytes.drain(at..at + length)),
            2 => {
                let stretch = bytes[at..at + length].to_vec();
                bytes.splice(at..at, stretch);
            }
            3 => bytes[at..at + length].fill(random.next_u64() as u8),
            4 => drop(bytes.splice(at..at, *b" 99999999999 ")),
            _ if at < bytes.len() => bytes[at] ^= 1 << random.below(8),
            _ => {}
        }
    }
}

#[test]
fn a_thousand_corrupted_files_are_read_or_refused_with_one_message() {
    let originals: [(&str, Vec<u8>); 9] = [
        ("scene.toml", SCENE.into()),
        ("scene.toml", SCENE.into()),
        ("cube.stl", stl_text().into()),
        ("cube.stl", stl_binary()),
        ("cube.obj", obj().into()),
        ("cube.ply", ply().into()),
        ("cube.glb", glb()),
        ("scan.pcd", pcd(false)),
        ("scan.pcd", pcd(true)),
    ];
    let directory = directory();
    let mut random = Rng::new(&[5]);
    let (mut read, mut refused) = (0, 0);
    for number in 0..1_000 {
        let (name, original) = &originals[number % originals.len()];
        let mut bytes = original.clone();
        mutate(&mut bytes, &mut random);
        let path = directory.path().join(format!("changed-{name}"));
        fs::write(&path, &bytes).unwrap();
        match load(&path) {
            Ok(loaded) => {
                assert!(!loaded.scene.distance(&Vector3::new(0.1, 0.2, 0.3)).is_nan());
                read += 1;
            }
            Err(error) => {
                let message = error.to_string();
                assert!(!message.contains('\n') && message.len() < 1000, "{message}");
                refused += 1;
            }
        }
    }
    println!("{read} read, {refused} refused");
    assert!(read > 50 && refused > 300, "{read} read, {refused} refused");
}
