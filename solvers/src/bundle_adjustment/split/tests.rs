//! Messages keep their bits, bytes that are none are refused, sections are sound.

use std::collections::BTreeSet;
use std::io::Cursor;

use proptest::prelude::*;

use super::codec::{decode, encode};
use super::frames::{read_message, serve, write_message};
use super::message::{Linearize, Motion};
use super::partition::Partition;
use super::*;
use crate::testing::scene::{Scene, SceneOptions};

/// A walk whose observations have depths, with relative poses.
fn scene(keyframes: usize) -> BundleProblem {
    // What one keyframe sees does not depend on their number.
    let laps = keyframes as f64 / 80.0;
    let options = SceneOptions { keyframes, laps, landmarks: 600, seed: 5, ..Default::default() };
    Scene::generate(&options).to_problem()
}

fn sections(problem: &BundleProblem, count: usize) -> Vec<Section> {
    let partition = Partition::new(problem, count, &Interrupt::NEVER).unwrap();
    (0..partition.sections.len()).map(|s| partition.section(problem, s)).collect()
}

/// Requests of every kind for one section.
fn requests() -> Vec<Request> {
    let section = sections(&scene(12), 2).remove(0);
    let values = Values::of(&section.problem);
    let linearize = Linearize { base: START, damping: 1e-4, stiffness: 1.0 };
    let motion = Motion { length: 1.0, has_inner_iterations: false };
    vec![
        Request::Open {
            class: Class::Scalar,
            ceiling_bytes: None,
            ceiling_flops: Some(1e12),
            keep_bytes: 1 << 30,
        },
        Request::Load { section: 0, source: Source::Here(Box::new(section)) },
        Request::SetValues { section: 0, version: 1, values },
        Request::Cost { section: 0, base: 1 },
        Request::Contribute { section: 0, linearize },
        Request::Move { section: 0, linearize, step: vec![0.5; 6], motion, version: 2 },
    ]
}

fn stream(requests: &[Request]) -> Vec<u8> {
    let mut bytes = Vec::new();
    requests.iter().for_each(|request| write_message(&mut bytes, request).unwrap());
    bytes
}

#[test]
fn messages_come_back_to_the_bit() {
    for request in requests() {
        assert_eq!(decode::<Request>(&encode(&request)).unwrap(), request);
    }
    let mut worker = Worker::new();
    for request in requests() {
        let answer = worker.answer(request, &Interrupt::NEVER);
        assert_eq!(decode::<Answer>(&encode(&answer)).unwrap(), answer);
    }
}

#[test]
fn every_factor_is_in_one_section_and_insides_do_not_touch() {
    let problem = scene(40);
    for wanted in [1, 2, 4, 7, 60] {
        let partition = Partition::new(&problem, wanted, &Interrupt::NEVER).unwrap();
        assert!(partition.sections.len() <= wanted);
        let mut observations: Vec<u32> = Vec::new();
        let mut relative_poses: Vec<u32> = Vec::new();
        let mut inside = BTreeSet::new();
        for (s, members) in partition.sections.iter().enumerate() {
            observations.extend(&members.observations);
            relative_poses.extend(&members.relative_poses);
            let section = partition.section(&problem, s);
            section.validate().unwrap();
            for (&pose, &is_border) in members.poses.iter().zip(&section.border_poses) {
                let is_constant = problem.constant_poses[pose as usize];
                let is_free = !is_border && !is_constant;
                assert!(!is_free || inside.insert(pose), "pose {pose} is inside of two sections");
            }
        }
        observations.sort_unstable();
        relative_poses.sort_unstable();
        assert_eq!(observations, (0..problem.observation_count() as u32).collect::<Vec<_>>());
        assert_eq!(relative_poses, (0..problem.relative_poses.len() as u32).collect::<Vec<_>>());
    }
}

#[test]
fn separators_of_a_walk_are_small_and_its_sections_alike() {
    let problem = scene(240);
    let partition = Partition::new(&problem, 4, &Interrupt::NEVER).unwrap();
    assert_eq!(partition.sections.len(), 4);
    let separate = partition.is_separator.iter().filter(|&&is_separator| is_separator).count();
    assert!(separate * 2 < problem.poses.len(), "{separate} poses separate");
    let sizes = partition.sections.iter().map(|members| members.observations.len());
    let (least, most) = (sizes.clone().min().unwrap(), sizes.max().unwrap());
    assert!(most < 3 * least, "{least} to {most} observations");
}

#[test]
fn a_worker_refuses_what_it_cannot_serve_and_goes_on() {
    let [open, load, set, cost, contribute, step] = <[Request; 6]>::try_from(requests()).unwrap();
    let mut worker = Worker::new();
    let mut refused = |request: &Request| {
        let answer = worker.answer(request.clone(), &Interrupt::NEVER);
        matches!(answer.reply, Reply::Refused(_))
    };
    assert!(refused(&load), "no session");
    assert!(!refused(&open));
    assert!(refused(&cost), "no section");
    assert!(!refused(&load));
    assert!(refused(&cost), "no version 1");
    assert!(!refused(&set));
    assert!(!refused(&cost));
    assert!(!refused(&contribute));
    assert!(refused(&step), "six unknowns are not this border's");
    let other = Request::SetValues { section: 0, version: 2, values: Values::default() };
    assert!(refused(&other), "values of another section");
    let Request::Load { source: Source::Here(mut section), .. } = load else { unreachable!() };
    section.border_poses.pop();
    assert!(refused(&Request::Load { section: 1, source: Source::Here(section) }));
    let path = std::path::PathBuf::from("no such file");
    let source = Source::File { path, offset: 0, length: 10 };
    assert!(refused(&Request::Load { section: 1, source }));
    assert!(!refused(&cost), "it still serves what it has");
}

#[test]
fn damage_of_a_file_of_sections_is_reported() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("sections");
    let made = sections(&scene(12), 2);
    let sources = file::write_sections(&path, made.clone().into_iter()).unwrap();
    for (source, section) in sources.iter().zip(&made) {
        let Source::File { path, offset, length } = source else { unreachable!() };
        assert_eq!(file::read_section(path, *offset, *length).unwrap(), *section);
        assert!(file::read_section(path, *offset, *length - 1).is_err());
        assert!(file::read_section(path, *offset + 1, *length).is_err());
    }
    let mut bytes = fs_err::read(&path).unwrap();
    bytes[100] ^= 1;
    fs_err::write(&path, bytes).unwrap();
    let Source::File { path, offset, length } = &sources[0] else { unreachable!() };
    assert!(file::read_section(path, *offset, *length).is_err());
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 64, ..ProptestConfig::default() })]

    #[test]
    fn bytes_that_are_no_message_are_refused_without_a_panic(
        bytes in proptest::collection::vec(any::<u8>(), 0..400),
    ) {
        let _any = decode::<Request>(&bytes);
        let _any = decode::<Answer>(&bytes);
        let mut output = Vec::new();
        let outcome = serve(&mut Cursor::new(&bytes), &mut output);
        prop_assert!(bytes.is_empty() || outcome.is_err());
    }

    #[test]
    fn a_stream_that_is_cut_off_or_damaged_ends_with_an_error(
        cut in 0.0..1.0_f64,
        bit in 0_usize..8,
        is_damage in any::<bool>(),
    ) {
        let mut bytes = stream(&requests()[..3]);
        let at = (cut * bytes.len() as f64) as usize;
        if is_damage {
            bytes[at] ^= 1 << bit;
        } else {
            bytes.truncate(at);
        }
        let mut input = Cursor::new(&bytes);
        let mut whole = 0;
        let outcome = loop {
            match read_message::<Request>(&mut input) {
                Ok(Some(_request)) => whole += 1,
                Ok(None) => break Ok(()),
                Err(error) => break Err(error),
            }
        };
        // Three bytes of the head are not looked at.
        prop_assert!(whole < 3 || (is_damage && outcome.is_ok()));
        let borders: Vec<usize> = (0..3).map(|n| stream(&requests()[..n]).len()).collect();
        prop_assert!(outcome.is_err() || is_damage || borders.contains(&at));
    }

    #[test]
    fn a_message_with_damage_that_its_checksum_does_not_see_makes_no_panic(
        share in 0.0..1.0_f64,
        value in any::<u8>(),
        which in 0_usize..6,
    ) {
        let mut worker = Worker::new();
        for (k, request) in requests().into_iter().enumerate() {
            let mut bytes = encode(&request);
            if k == which {
                let at = (share * bytes.len() as f64) as usize;
                bytes[at] = value;
            }
            let Ok(request) = decode::<Request>(&bytes) else { return Ok(()) };
            let _answer = worker.answer(request, &Interrupt::NEVER);
        }
    }
}
