//! The seeds: real encodings, small, at least one of each thing that a parser knows.

use std::path::Path;

use crate::frontend::image::Image;
use crate::frontend::input::encode;

use super::wire_seeds;

type Seed = (&'static str, &'static str, Vec<u8>);

/// Every seed as target, name and bytes.
pub(super) fn all() -> Vec<Seed> {
    let mut seeds = Vec::new();
    let mut put = |target, all: Vec<(&'static str, Vec<u8>)>| {
        seeds.extend(all.into_iter().map(|(name, bytes)| (target, name, bytes)));
    };
    put("bal", texts(&BAL));
    put("g2o", texts(&G2O));
    put("pyfg", texts(&PYFG));
    put("trajectory", texts(&TRAJECTORY));
    put("pose_matrix", texts(&POSE_MATRIX));
    put("config", texts(&CONFIG));
    put("camera_file", texts(&CAMERA_FILE));
    put("frame_list", texts(&FRAME_LIST));
    put("image", images());
    put("capture", crate::frontend::input::fuzzing::capture_seeds());
    put("ros_message", crate::frontend::input::fuzzing::ros_messages::seeds());
    put("tokens", texts(&TOKENS));
    put("jwt", JWT.map(|(name, parts)| (name, parts.join("\0").into_bytes())).into());
    put("pem", pem());
    put(
        "colmap_text",
        COLMAP.map(|(name, files)| (name, joined(&files.map(str::as_bytes)))).into(),
    );
    put("colmap_binary", colmap_binary());
    put("volume", crate::frontend::dense::file::fuzzing::seeds());
    put("wire_item", wire_seeds::items());
    put("wire_requests", wire_seeds::requests());
    seeds
}

fn texts(all: &[(&'static str, &str)]) -> Vec<(&'static str, Vec<u8>)> {
    all.iter().map(|&(name, text)| (name, text.as_bytes().to_vec())).collect()
}

const BAL: [(&str, &str); 6] = [
    (
        "two-cameras",
        "2 2 4\n0 0 -3.3e2 2.6e2\n0 1 -1.9e2 1.2e2\n1 0 5 6\n1 1 7.5 -8\n\
         0.01\n-0.02\n0.03\n-0.1\n0.2\n-0.3\n399.5\n-3e-7\n5e-13\n\
         0\n0\n0\n0\n0\n0\n400\n0\n0\n-0.6\n0.5\n-1.2\n1.5\n-0.25\n-3\n",
    ),
    ("one-line", "1 1 1 0 0 1 2 0 0 0 0 0 0 1 0 0 1 2 -3"),
    ("empty", "0 0 0\n"),
    ("half-turn", "1 1 1 0 0 1 2 3.141592653589793 0 0 0 0 0 1 0 0 1 2 -3"),
    ("subnormal", "1 1 1 0 0 5e-324 -0 1e-300 1e-300 0 0 -0 0 1 0 0 1.7976931348623157e308 2 -3"),
    ("mark-and-tabs", "\u{feff}1\t1 1\r\n0 0 1 2\r\n0 0 0 0 0 0 1 0 0 1 2 -3"),
];

const G2O: [(&str, &str); 8] = [
    (
        "se2",
        "VERTEX_SE2 0 0 0 0\nVERTEX_SE2 1 1 0 0.1\nVERTEX_SE2 2 1 1 -3.1\nFIX 0\n\
         EDGE_SE2 0 1 1 0 0.1 500 0 0 500 0 5000\nEDGE_SE2 1 2 0 1 1.5 500 1 2 500 3 5000\n",
    ),
    (
        "se3",
        "VERTEX_SE3:QUAT 0 0 0 0 0 0 0 1\nVERTEX_SE3:QUAT 7 1 2 3 0.5 0.5 0.5 0.5\n\
         EDGE_SE3:QUAT 0 7 1 2 3 0 0 0.6 0.8 1 0 0 0 0 0 1 0 0 0 0 1 0 0 0 1 0 0 1 0 1\n",
    ),
    ("edges-only", "EDGE_SE2 5 -3 1 0 0 1 0 0 1 0 1\nEDGE_SE2 -3 9 1 0 0 1 0 0 1 0 1\n"),
    ("comments", "# a graph\n\n  VERTEX_SE2 1 1 1 1\r\n#\nFIX 1 1\n"),
    ("indefinite", "EDGE_SE2 0 1 1 0 0.1 1 2 0 1 0 1\n"),
    ("singular", "EDGE_SE2 0 1 1 0 0.1 0 0 0 0 0 1\nEDGE_SE2 1 2 1 0 0.1 1 1 0 1 0 0\n"),
    (
        "indefinite-se3",
        "EDGE_SE3:QUAT 0 7 1 2 3 0 0 0.6 0.8 1 9 0 0 0 0 1 0 0 0 0 1 0 0 0 -1 0 0 1 0 1\n",
    ),
    ("extreme", "EDGE_SE2 0 1 1e308 0 1e17 1e308 1e300 -1e-308 1e308 5e-324 1e308\n"),
];

const PYFG: [(&str, &str); 4] = [
    (
        "plane",
        "VERTEX_SE2 0.000000000 A0 0.0 0.0 0.0\nVERTEX_SE2 1e9 A1 1 0 0.1\nVERTEX_XY L0 11.0 19.0\n\
         VERTEX_SE2:PRIOR 0 A1 1 0 0 0.1 0 0 0.1 0 0.2\nVERTEX_XY:PRIOR 0 L0 1 2 0.1 0 0.1\n\
         EDGE_SE2 0 A0 A1 1.0 0.0 0.0 1.0 0.0 -0.0 1.0 -0.0 1.0\n\
         EDGE_SE2_XY 0 A0 L0 1 2 0.1 0.01 0.1\nEDGE_RANGE 0.0 A1 L0 21.470910554 1.0\n",
    ),
    (
        "space",
        "VERTEX_SE3:QUAT 1 A0 0 0 0 0 0 0 1\nVERTEX_SE3:QUAT 1.5 B7 1 2 3 0.5 0.5 0.5 0.5\n\
         VERTEX_XYZ L1 1 2 3\nVERTEX_XYZ:PRIOR 2 L1 1 2 3 1 0 0 1 0 1\n\
         VERTEX_SE3:QUAT:PRIOR 1 A0 0 0 0 0 0 0 1 1 0 0 0 0 0 1 0 0 0 0 1 0 0 0 1 0 0 1 0 1\n\
         EDGE_SE3:QUAT 1 A0 B7 1 2 3 0 0 0.6 0.8 1 0 0 0 0 0 1 0 0 0 0 1 0 0 0 1 0 0 1 0 1\n\
         EDGE_SE3_XYZ 1 B7 L1 1 2 3 1 0 0 1 0 1\nEDGE_RANGE 0 A0 B7 3.7 0.01\n",
    ),
    (
        "landmarks",
        "# no pose\nVERTEX_XY L0 11 19\nVERTEX_XY L1 11 21\nEDGE_RANGE 0.0 L0 L1 2.0 1.0\n",
    ),
    ("extreme", "VERTEX_SE2 -1e-308 z281474976710655 1e308 0 1e17\nEDGE_NEW 1 2\n"),
];

const TRAJECTORY: [(&str, &str); 6] = [
    ("plain", "# timestamp tx ty tz qx qy qz qw\n1.5 1 2 3 0 0 0 1\n2.5 1 2 3 0 0.6 0 0.8\n"),
    ("epoch", "1305031102.175304 1.3405 0.6266 1.6575 0.6574 0.6126 -0.2949 -0.3248\n"),
    ("no-newline", "0 0 0 0 0 0 0 -1"),
    ("empty", ""),
    ("long", "1 1 2 3 0 0 0 1 9\n"),
    ("not-quite-unit", "1 1 2 3 0.57735 0.57735 0.57735 0.0005\n-1 1e300 -0 5e-324 1 0 0 1e-4\n"),
];

const POSE_MATRIX: [(&str, &str); 6] = [
    ("plain", "1 0 0 1.5\n0 1 0 -2\n0 0 1 3\n0 0 0 1\n"),
    (
        "printed",
        "-9.6e-001\t 2.8000000e-001\t 0\t 4.1\t \n2.8e-001\t 9.6e-001\t 0\t -1\t \n\
         0\t 0\t -1\t 3e-1\t \n0\t 0\t 0\t 1\t \n",
    ),
    ("unknown", "-inf -inf -inf -inf -inf -inf -inf -inf -inf -inf -inf -inf -inf -inf -inf -inf"),
    ("mirrors", "1 0 0 0 0 1 0 0 0 0 -1 0 0 0 0 1"),
    ("not-quite-rigid", "1.0004 0 0 1e300 0 0.9996 0 -0 0 0 1 5e-324 0 1e-4 0 1"),
    ("cut", "1 0 0 0 0 1 0"),
];

const CONFIG: [(&str, &str); 8] = [
    (
        "all",
        "listen = '0.0.0.0:7411'\nserver = 'https://host:1'\nca = 'ca.pem'\ncert = 'c'\nkey = 'k'\n\
         token_file = 't'\ntls_cert = 'a'\ntls_key = 'b'\ntls_client_ca = 'c'\ntokens = 'tokens'\n\
         insecure_plain_text = true\nthreads = 2\nlock_step = false\nmax_message_bytes = 4194304\n\
         max_concurrent_streams = 64\nqueue_capacity = 64\ndata_dir = \"d\\u00e4ta\"\nlog = 'info'\n",
    ),
    ("in-memory", "in_memory = true # not kept\n"),
    ("unknown-key", "lisen = 'a'\n"),
    ("token", "log = 'info'\ntoken = 'secret'\n"),
    ("wrong-type", "threads = -1\n"),
    ("unfinished", "log = \"\"\"in\\u00"),
    (
        "policy",
        "window_keyframe_count = 20\ngauge = \"first-keyframe-fixed\"\nodometry = false\n\
         observation_loss = { kind = 'huber', width = 2 }\n[loop_closure_robustness]\n\
         kernel = 'gnc-tls'\nthreshold = 1e1\n[geodetic_anchor]\nlatitude_deg = nan\n\
         longitude_deg = -0.0\nheight_m = inf\n[limits]\nmax_size_bytes = 9223372036854775807\n",
    ),
    ("policy-unknown-key", "[limits]\nmax_keyframes = 1\n"),
];

const TOKENS: [(&str, &str); 6] = [
    (
        "two",
        "[[token]]\nname = 'robot-7'\ntenant = 'acme'\nrole = 'write'\n\
         sha256 = '9f86d081884c7d659a2feaa0c55ad015a3bf4f1b2b0b822cd15d6c15b0f00a08'\n\
         [[token]]\nname = 'eye'\nrole = \"read\"\n\
         sha256 = '0f86d081884c7d659a2feaa0c55ad015a3bf4f1b2b0b822cd15d6c15b0f00a08'\n",
    ),
    (
        "inline",
        "token = [{name='a', role='admin', \
         sha256='9f86d081884c7d659a2feaa0c55ad015a3bf4f1b2b0b822cd15d6c15b0f00a08'}]\n",
    ),
    ("empty", ""),
    ("no-digits", "[[token]]\nname='a'\nrole='read'\nsha256='\u{e9}\u{e9}'\n"),
    ("unknown-role", "[[token]]\nname='a'\nrole='root'\nsha256=''\n"),
    ("not-a-list", "token = 3\n"),
];

const CAMERA_FILE: [(&str, &str); 5] = [
    ("four", "517.3 516.5 318.6 255.3\n"),
    (
        "nine-and-timing",
        "# fx fy cx cy k1 k2 p1 p2 k3\n# readout_s 0.02\n# depth_late_s -0.015\n\
         535.4,539.2,320.1,247.6 0.1 -0.2 1e-3 -1e-3 0.05 # a lens\n",
    ),
    ("five", "1 1 1 1 1"),
    ("folds-back", "1 1 4 3 -9 40 3 -3 -1e3"),
    ("not-finite", "1 inf 1 1"),
];

const FRAME_LIST: [(&str, &str); 6] = [
    ("empty", ""),
    ("extreme", "-1.7976931348623157e308 a\n5e-324 \u{e9}/\u{301}.png\n"),
    ("three", "# color\n1.5 rgb/a.png\r\n\n2\trgb/b b.png\n 2.5 ./c.jpg"),
    ("outside", "1 ../a.png\n"),
    ("absolute", "1 /a.png\n"),
    ("no-time", "a.png\n"),
];

/// One of each kind that is read.
fn images() -> Vec<(&'static str, Vec<u8>)> {
    let color = Image::filled(5, 3, [200_u8, 100, 0]);
    let depth = Image::from_pixels(4, 2, vec![0_u16, 1, 5000, 65_535, 7, 8, 9, 10]);
    let written = [
        ("color", encode::rgb(&color).ok()),
        ("mask", encode::gray8(&Image::filled(9, 2, 255)).ok()),
        ("depth", depth.and_then(|depth| encode::gray16(&depth).ok())),
        ("palette", palette()),
    ];
    let mut seeds: Vec<_> = written.map(|(name, bytes)| (name, bytes.unwrap())).into();
    seeds.push(("orange", ORANGE.to_vec()));
    seeds
}

/// The JPEG of the decoder's own tests.
const ORANGE: &[u8] = include_bytes!("../../../frontend/src/input/decode/tests/orange.jpg");

/// An interlaced PNG with four colors, one of them transparent.
fn palette() -> Option<Vec<u8>> {
    let mut bytes = Vec::new();
    let mut encoder = png::Encoder::new(&mut bytes, 4, 4);
    encoder.set_color(png::ColorType::Indexed);
    encoder.set_depth(png::BitDepth::Two);
    encoder.set_palette(vec![0, 0, 0, 255, 0, 0, 0, 255, 0, 0, 0, 255]);
    encoder.set_trns(vec![0]);
    let mut writer = encoder.write_header().ok()?;
    writer.write_image_data(&[0b0001_1011; 4]).ok()?;
    writer.finish().ok()?;
    Some(bytes)
}

/// Keys, header, claims. The keys are of nobody: random numbers of the right length.
const JWT: [(&str, [&str; 3]); 6] = [
    (
        "ed25519",
        [
            "{\"keys\":[{\"kty\":\"OKP\",\"crv\":\"Ed25519\",\"kid\":\"o\",\"alg\":\"EdDSA\",\
             \"x\":\"11qYAYKxCrfVS_7TyWQHOg7hcvPapiMlrwIaaPcHURo\"}]}",
            "{\"alg\":\"EdDSA\",\"kid\":\"o\",\"typ\":\"JWT\"}",
            "{\"iss\":\"https://issuer\",\"aud\":\"covis\",\"sub\":\"robot-7\",\"exp\":1800000300,\
             \"covis_role\":\"write\",\"covis_tenant\":\"acme\"}",
        ],
    ),
    (
        "p256",
        [
            "{\"keys\":[{\"kty\":\"EC\",\"crv\":\"P-256\",\"kid\":\"e\",\"use\":\"sig\",\
             \"x\":\"f83OJ3D2xF1Bg8vub9tLe1gHMzV76e8Tus9uPHvRVEU\",\
             \"y\":\"x_FEzRu9m36HLN_tue659LNpXW6pCyStikYjKIWI5a0\"}]}",
            "{\"alg\":\"ES256\",\"kid\":\"e\",\"crit\":[\"b64\"]}",
            "{\"iss\":\"https://issuer\",\"aud\":[\"other\",\"covis\"],\"sub\":\"r\",\
             \"exp\":1.8000003e9,\"nbf\":1799999999,\"covis_role\":\"read\"}",
        ],
    ),
    (
        "kinds-that-are-passed-over",
        [
            "{\"keys\":[{\"kty\":\"oct\",\"k\":\"AAAA\"},{\"kty\":\"RSA\",\"use\":\"enc\"},\
             {\"kty\":\"RSA\",\"kid\":\"r\",\"e\":\"AQAB\",\"n\":\"AQAB\"}]}",
            "{\"alg\":\"RS256\",\"kid\":\"r\"}",
            "{\"exp\":1e300,\"iss\":3}",
        ],
    ),
    ("private", ["{\"keys\":[{\"kty\":\"OKP\",\"d\":\"AA\"}]}", "{\"alg\":\"none\"}", "{}"]),
    ("times-at-the-ends", ["{\"keys\":[]}", "{}", "{\"exp\":9223372036854775807,\"nbf\":-1e18}"]),
    ("deep", ["[[[[[[[[[[[[[[[[", "{\"kid\":[[[[", "{\"aud\":[[[[[[[["]),
];

/// Cameras, images, points.
const COLMAP: [(&str, [&str; 3]); 5] = [
    (
        "model",
        [
            "# cameras\n1 OPENCV 640 480 520 515 321.5 239 -0.12 0.03 8e-4 -5e-4\n\
             4 SIMPLE_RADIAL 640 480 500 320 240 0.02\n",
            "# images\n7 0.6 0.8 0 0 0.5 -0.1 -0.05 1 frame 2.jpg\n1 2 5 3.5 4 -1\n\
             9 1 0 0 0 0 0 0 4 frame_10.jpg\n5 6 5\n",
            "5 1.5 2 3 10 20 30 0.5 7 0 9 0\n8 0 0 0 0 0 0 -1\n",
        ],
    ),
    ("no-keypoints", ["1 PINHOLE 2 2 1 1 1 1", "1 1 0 0 0 0 0 0 1 a\n\n", ""]),
    ("other-models", ["1 FOV 2 2 1 1 1 1 1\n2 RADIAL_FISHEYE 2 2 1 1 1 1 1\n", "", ""]),
    ("empty", ["", "", ""]),
    ("name-with-a-hash", ["1 PINHOLE 2 2 1 1 1 1", "1 1 0 0 0 0 0 0 1 # a\n1 1 -1", ""]),
];

/// The three files behind the two cuts.
fn joined(files: &[&[u8]; 3]) -> Vec<u8> {
    let cuts = [files[0].len(), files[0].len() + files[1].len()];
    let cuts = cuts.iter().flat_map(|&cut| u16::try_from(cut).unwrap().to_le_bytes());
    cuts.chain(files.concat()).collect()
}

fn colmap_binary() -> Vec<(&'static str, Vec<u8>)> {
    use covis_solvers::io::colmap::{ColmapEncoding, ColmapModel};
    let binary = |(name, files): (&'static str, [&str; 3])| {
        let files = files.map(str::as_bytes);
        let model = ColmapModel::parse(ColmapEncoding::Text, files, Path::new("seed")).unwrap();
        let files = model.to_files(ColmapEncoding::Binary).unwrap();
        let parts: Vec<&[u8]> = files.iter().map(|(_, bytes)| &bytes[..]).collect();
        (name, joined(&parts.try_into().unwrap()))
    };
    COLMAP.into_iter().map(binary).collect()
}

/// A certificate of a throw-away authority; keys are only malformed, so that none lies about.
fn pem() -> Vec<(&'static str, Vec<u8>)> {
    let signed = rcgen::generate_simple_self_signed(vec!["localhost".to_owned()]).unwrap();
    let certificate = signed.cert.pem();
    let key = |kind: &str| {
        format!("-----BEGIN {kind}-----\nMC4CAQAwBQYDK2VwBCIEIA==\n-----END {kind}-----\n")
    };
    vec![
        ("certificate", certificate.clone().into_bytes()),
        ("two-certificates", [&certificate[..], "text between\n", &certificate].concat().into()),
        ("short-key", key("PRIVATE KEY").into()),
        ("short-ec-key", key("EC PRIVATE KEY").into()),
        ("short-rsa-key", key("RSA PRIVATE KEY").into()),
        ("no-end", b"-----BEGIN CERTIFICATE-----\nAAAA\n".to_vec()),
    ]
}
