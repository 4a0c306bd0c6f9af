//! A job in an answer: what a record holds, with its long lists cut, so that no job is too long for a message.
//!
//! What is left out is counted in `Job.shortened_lists` and named with the file that has it. Records that
//! an earlier version wrote may be longer than any message: they are cut in the same way when they are read.
//!
//! | bytes | what |
//! |---|---|
//! | [`ANSWER_BYTES`] | a job |
//! | [`PROBLEMS_BYTES`] | the problems that it solved, without the lists within them |
//! | [`LIST_BYTES`] | any other list, in a job that is longer than that |
//! | [`MESSAGE_BYTES`] | why it failed |

use prost::Message;

use super::run::REPORT;
use crate::service::convert::count;
use crate::service::listing::ENTRY_OVERHEAD;
use crate::wire::v1;
use v1::job_result::Result as Kind;
use v1::job_spec::Spec;

/// Most bytes of a job in an answer. A page of jobs, cut at 1 MiB, stays far below the 4 MiB that clients
/// of gRPC take by default.
pub(super) const ANSWER_BYTES: usize = 256 << 10;
/// Most bytes of the problems in a job that is longer than an answer.
const PROBLEMS_BYTES: usize = 96 << 10;
/// Most bytes of each other list in such a job. It has four at most.
const LIST_BYTES: usize = 32 << 10;
/// Most bytes of the message of a failure.
const MESSAGE_BYTES: usize = 4 << 10;
/// Most bytes of the problems that are kept in the record of a job that runs; of the others the costs are.
const DONE_BYTES: usize = 128 << 10;

/// Cuts the lists of a job that is too long for an answer. Again, it changes nothing.
pub(super) fn shorten(job: &mut v1::Job) {
    let mut lists = Lists(std::mem::take(&mut job.shortened_lists));
    // The truth of an evaluation may be as long as a message, and its client has it.
    if let Some(Spec::EvaluateTrajectory(spec)) =
        job.spec.as_mut().and_then(|spec| spec.spec.as_mut())
    {
        // Without its memory too: a vector that is cleared keeps it.
        spec.truth = Vec::new();
    }
    if let Some(failure) = &mut job.failure {
        cut_text(&mut failure.message);
    }
    if job.encoded_len() > ANSWER_BYTES {
        cut_spec(&mut lists, job.spec.as_mut().and_then(|spec| spec.spec.as_mut()));
        lists.cut("files", "", &mut job.files, LIST_BYTES);
        cut_result(&mut lists, job.result.as_mut().and_then(|result| result.result.as_mut()));
    }
    count_unplaced(&mut lists, job.result.as_ref().and_then(|result| result.result.as_ref()));
    job.shortened_lists = lists.0;
}

/// Forgets how many files there were: all are in the list again.
pub(super) fn forget_files(job: &mut v1::Job) {
    job.shortened_lists.retain(|list| list.field_path != "files");
}

/// The lists that are longer than they are in the answer.
struct Lists(Vec<v1::ShortenedList>);

impl Lists {
    /// Notes how long a list is. One that was cut before is known to be at least as long as it was then.
    fn note(&mut self, field: &str, entries: i64, file: &str) {
        match self.0.iter_mut().find(|list| list.field_path == field) {
            Some(list) => list.entry_count = list.entry_count.max(entries),
            None => self.0.push(v1::ShortenedList {
                field_path: field.to_owned(),
                entry_count: entries,
                file_path: file.to_owned(),
            }),
        }
    }

    /// Notes lists of keyframes: a reconstruction knows how many were not placed.
    fn note_unplaced<'a>(
        &mut self,
        at: &str,
        reconstructions: impl Iterator<Item = &'a v1::Reconstruction>,
    ) {
        let (mut all, mut here) = (0, 0);
        for found in reconstructions {
            all += found.keyframe_count - found.placed_keyframe_count;
            here += count(found.unplaced_keyframes.len());
        }
        if here < all {
            self.note(&format!("{at}.unplaced_keyframes"), all, REPORT);
        }
    }

    /// Leaves as many entries of a list as fit.
    fn cut<T: Message>(&mut self, field: &str, file: &str, entries: &mut Vec<T>, most: usize) {
        let fitting = fitting(entries, most);
        if fitting < entries.len() {
            self.note(field, count(entries.len()), file);
            entries.truncate(fitting);
            entries.shrink_to_fit();
        }
    }
}

/// How many of the first entries have at most `most` bytes together.
fn fitting<T: Message>(entries: &[T], most: usize) -> usize {
    let mut bytes = 0;
    let fits = |entry: &&T| {
        bytes += entry.encoded_len() + ENTRY_OVERHEAD;
        bytes <= most
    };
    entries.iter().take_while(fits).count()
}

fn cut_text(text: &mut String) {
    if text.len() > MESSAGE_BYTES {
        let end = text.floor_char_boundary(MESSAGE_BYTES);
        text.truncate(end);
        text.push('…');
    }
}

fn cut_spec(lists: &mut Lists, spec: Option<&mut Spec>) {
    if let Some(Spec::MergeMaps(request)) = spec {
        lists.cut("spec.merge_maps.constraints", "", &mut request.constraints, LIST_BYTES);
        let renamed = &mut request.renamed_clients;
        lists.cut("spec.merge_maps.renamed_clients", "", renamed, LIST_BYTES);
    }
}

fn cut_result(lists: &mut Lists, result: Option<&mut Kind>) {
    match result {
        Some(Kind::OptimizeMap(result)) => {
            // How many there are is known, where it was not an earlier version that counted them.
            let (field, all) = (
                "result.optimize_map.switched_off_constraints",
                result.switched_off_constraint_count,
            );
            lists.cut(field, "", &mut result.switched_off_constraints, LIST_BYTES);
            if count(result.switched_off_constraints.len()) < all {
                lists.note(field, all, "");
            }
            cut_summary(lists, "result.optimize_map.summary", result.summary.as_mut());
        }
        Some(Kind::MergeMaps(response)) => {
            cut_map(lists, "result.merge_maps.map", response.map.as_mut());
        }
        Some(Kind::RebuildMap(result)) => {
            cut_map(lists, "result.rebuild_map.map", result.map.as_mut());
        }
        Some(Kind::SolveFiles(result)) => {
            cut_problems(lists, "result.solve_files.problems", &mut result.problems);
        }
        Some(Kind::Reconstruct(result)) => {
            cut_summary(lists, "result.reconstruct.summary", result.summary.as_mut());
            cut_problems(lists, "result.reconstruct.problems", &mut result.problems);
            if let Some(found) = &mut result.reconstruction {
                cut_unplaced(&mut found.unplaced_keyframes, LIST_BYTES);
            }
        }
        Some(Kind::CompactMap(_) | Kind::EvaluateTrajectory(_) | Kind::ExportMap(_)) | None => {}
    }
}

fn cut_summary(lists: &mut Lists, at: &str, summary: Option<&mut v1::SolveSummary>) {
    if let Some(closures) = summary.and_then(|summary| summary.closures.as_mut()) {
        let field = format!("{at}.closures.variance_factors");
        lists.cut(&field, "", &mut closures.variance_factors, LIST_BYTES);
    }
}

fn cut_map(lists: &mut Lists, at: &str, map: Option<&mut v1::Map>) {
    if let Some(map) = map {
        lists.cut(&format!("{at}.clients"), "", &mut map.clients, LIST_BYTES);
        lists.cut(&format!("{at}.merged_maps"), "", &mut map.merged_maps, LIST_BYTES);
    }
}

/// Leaves the first problems, each with its share of the lists of keyframes.
fn cut_problems(lists: &mut Lists, field: &str, problems: &mut Vec<v1::SolvedProblem>) {
    let take = |problem: &mut v1::SolvedProblem| {
        let found = problem.reconstruction.as_mut();
        found.map_or_else(Vec::new, |found| std::mem::take(&mut found.unplaced_keyframes))
    };
    let unplaced: Vec<_> = problems.iter_mut().map(take).collect();
    lists.cut(field, REPORT, problems, PROBLEMS_BYTES);
    let share = LIST_BYTES / problems.len().max(1);
    for (problem, mut unplaced) in problems.iter_mut().zip(unplaced) {
        if let Some(found) = &mut problem.reconstruction {
            cut_unplaced(&mut unplaced, share);
            found.unplaced_keyframes = unplaced;
        }
    }
}

fn cut_unplaced(unplaced: &mut Vec<v1::UnplacedKeyframe>, most: usize) {
    let fitting = fitting(unplaced, most);
    unplaced.truncate(fitting);
    unplaced.shrink_to_fit();
}

/// Notes lists of keyframes that are not complete.
fn count_unplaced(lists: &mut Lists, result: Option<&Kind>) {
    let Some(Kind::Reconstruct(result)) = result else { return };
    let of_problems = result.problems.iter().filter_map(|problem| problem.reconstruction.as_ref());
    lists.note_unplaced("result.reconstruct.reconstruction", result.reconstruction.iter());
    lists.note_unplaced("result.reconstruct.problems.reconstruction", of_problems);
}

/// Adds a problem to those that a running job has solved, of `all`: with its share of the lists, or, where
/// there is no room any more, with its costs alone.
pub(super) fn add_solved(
    done: &mut Vec<v1::SolvedProblem>,
    mut problem: v1::SolvedProblem,
    all: usize,
) {
    if let Some(found) = &mut problem.reconstruction {
        let unplaced = std::mem::take(&mut found.unplaced_keyframes);
        let room = (DONE_BYTES / all.max(1)).saturating_sub(problem.encoded_len());
        if let Some(found) = &mut problem.reconstruction {
            found.unplaced_keyframes = unplaced;
            cut_unplaced(&mut found.unplaced_keyframes, room);
        }
    }
    let held: usize = done.iter().map(|solved| solved.encoded_len() + ENTRY_OVERHEAD).sum();
    let has_room = held + problem.encoded_len() <= DONE_BYTES
        && done.last().is_none_or(|last| !has_costs_alone(last));
    if !has_room {
        let of = problem.summary.unwrap_or_default();
        let (initial_cost, final_cost) = (of.initial_cost, of.final_cost);
        let summary = v1::SolveSummary { initial_cost, final_cost, ..Default::default() };
        problem = v1::SolvedProblem { summary: Some(summary), ..Default::default() };
    }
    done.push(problem);
}

/// What a running job had solved, within these bounds also where an earlier version wrote it.
pub(super) fn done_within_bounds(done: v1::JobResult) -> v1::JobResult {
    let Some(Kind::SolveFiles(solved)) = done.result else { return done };
    let (all, mut problems) = (solved.problems.len(), Vec::new());
    for problem in solved.problems {
        if has_costs_alone(&problem) {
            problems.push(problem);
        } else {
            add_solved(&mut problems, problem, all);
        }
    }
    v1::JobResult { result: Some(Kind::SolveFiles(v1::SolveFilesResult { problems })) }
}

/// Whether only the costs of a problem are kept: each problem has a path.
fn has_costs_alone(problem: &v1::SolvedProblem) -> bool {
    problem.path.is_empty()
}

/// The problems for the result of a job, and, where only the costs of some are kept, how many there are.
pub(super) fn solved(
    mut done: Vec<v1::SolvedProblem>,
    field: &str,
) -> (Vec<v1::SolvedProblem>, Option<v1::ShortenedList>) {
    let all = done.len();
    done.retain(|problem| !has_costs_alone(problem));
    let list = (done.len() < all).then(|| v1::ShortenedList {
        field_path: field.to_owned(),
        entry_count: count(all),
        file_path: REPORT.to_owned(),
    });
    (done, list)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn unplaced(count: i64) -> Vec<v1::UnplacedKeyframe> {
        let reason = "it shares fewer landmarks than needed with the keyframes that are placed";
        let keyframe =
            |id| v1::UnplacedKeyframe { id, reason: reason.to_owned(), ..Default::default() };
        (0..count).map(keyframe).collect()
    }

    fn problem(index: usize, unplaced_count: i64) -> v1::SolvedProblem {
        let summary = v1::SolveSummary {
            initial_cost: 2.0 + index as f64,
            final_cost: 1.0 / (1.0 + index as f64),
            description: "converged: the cost falls no more".to_owned(),
            ..Default::default()
        };
        let found = v1::Reconstruction {
            keyframe_count: unplaced_count + 10,
            placed_keyframe_count: 10,
            unplaced_keyframes: unplaced(unplaced_count.min(1000)),
            ..Default::default()
        };
        let path = format!("scene-{index}/{}", "d".repeat(900));
        v1::SolvedProblem { path, summary: Some(summary), reconstruction: Some(found) }
    }

    fn reconstructed(problems: Vec<v1::SolvedProblem>) -> v1::Job {
        let result = v1::ReconstructResult { problems, ..Default::default() };
        let result = v1::JobResult { result: Some(Kind::Reconstruct(result)) };
        v1::Job { job_id: "night".to_owned(), result: Some(result), ..Default::default() }
    }

    #[test]
    fn a_job_of_any_length_fits_an_answer_and_says_what_is_left_out() {
        // What an earlier version wrote: more than a message of gRPC.
        let mut job = reconstructed((0..60).map(|index| problem(index, 1_200)).collect());
        let file =
            |index| v1::JobFile { path: format!("{index}/{}", "f".repeat(1000)), size_bytes: 1 };
        job.files = (0..1025).map(file).collect();
        assert!(job.encoded_len() > 4 << 20);
        shorten(&mut job);
        assert!(job.encoded_len() <= ANSWER_BYTES, "{}", job.encoded_len());
        let again = job.clone();
        shorten(&mut job);
        assert_eq!(job, again, "what is short enough stays");
        let lists: Vec<_> = job
            .shortened_lists
            .iter()
            .map(|list| (list.field_path.as_str(), list.entry_count, list.file_path.as_str()))
            .collect();
        let at = "result.reconstruct.problems.reconstruction.unplaced_keyframes";
        assert_eq!(lists, [("files", 1025, ""), (at, 60 * 1_200, "report.json")]);
        let Some(Kind::Reconstruct(result)) = job.result.unwrap().result else { panic!() };
        assert_eq!(result.problems.len(), 60);
        assert!(result.problems.iter().all(|of| {
            let found = of.reconstruction.as_ref().unwrap();
            !found.unplaced_keyframes.is_empty() && found.keyframe_count == 1_210
        }));
    }

    #[test]
    fn a_job_keeps_no_memory_of_its_truth() {
        let truth = vec![v1::KeyframePose::default(); 10_000];
        let spec = v1::EvaluateTrajectorySpec { truth, ..Default::default() };
        let spec = Some(v1::JobSpec { spec: Some(Spec::EvaluateTrajectory(spec)) });
        let mut job = v1::Job { spec, ..Default::default() };
        shorten(&mut job);
        let Some(Spec::EvaluateTrajectory(spec)) = job.spec.unwrap().spec else { panic!() };
        assert_eq!(spec.truth.capacity(), 0);
    }

    #[test]
    fn of_very_many_problems_the_first_are_answered() {
        let mut job = reconstructed((0..1024).map(|index| problem(index, 0)).collect());
        shorten(&mut job);
        assert!(job.encoded_len() <= ANSWER_BYTES);
        let list = &job.shortened_lists[0];
        assert_eq!(
            (list.field_path.as_str(), list.entry_count, list.file_path.as_str()),
            ("result.reconstruct.problems", 1024, "report.json")
        );
    }

    #[test]
    fn a_job_within_the_limit_is_answered_as_it_is() {
        let mut job = reconstructed(vec![problem(0, 900)]);
        let whole = job.clone();
        shorten(&mut job);
        assert_eq!(job, whole);
    }

    #[test]
    fn what_a_running_job_keeps_of_its_problems_is_bounded_and_has_every_cost() {
        let (mut done, all) = (Vec::new(), 1024);
        for index in 0..all {
            add_solved(&mut done, problem(index, 1_200), all);
        }
        let bytes: usize = done.iter().map(Message::encoded_len).sum();
        assert!(bytes <= DONE_BYTES + 32 * all, "{bytes}");
        for (index, solved) in done.iter().enumerate() {
            let (wanted, found) =
                (problem(index, 0).summary.unwrap(), solved.summary.as_ref().unwrap());
            assert_eq!(found.initial_cost.to_bits(), wanted.initial_cost.to_bits());
            assert_eq!(found.final_cost.to_bits(), wanted.final_cost.to_bits());
        }
        let (first, list) = solved(done, "result.solve_files.problems");
        assert!(first.len() > 50 && first.iter().all(|problem| !problem.path.is_empty()));
        assert_eq!(list.unwrap().entry_count, 1024);
        let mut few = Vec::new();
        add_solved(&mut few, problem(0, 800), 1);
        assert_eq!(few, [problem(0, 800)], "one problem keeps all of its lists");
    }

    #[test]
    fn the_lists_of_a_merge_are_cut_too() {
        let renamed = |index| v1::RenamedClient {
            client_id: format!("{index:0>63}"),
            new_client_id: format!("{index:1>63}"),
        };
        let request = v1::MergeMapsRequest {
            renamed_clients: (0..10_000).map(renamed).collect(),
            ..Default::default()
        };
        let client =
            |index| v1::MapClient { client_id: format!("{index:0>63}"), ..Default::default() };
        let map = v1::Map { clients: (0..10_000).map(client).collect(), ..Default::default() };
        let result = v1::MergeMapsResponse { map: Some(map), ..Default::default() };
        let mut job = v1::Job {
            spec: Some(v1::JobSpec { spec: Some(Spec::MergeMaps(request)) }),
            result: Some(v1::JobResult { result: Some(Kind::MergeMaps(result)) }),
            ..Default::default()
        };
        shorten(&mut job);
        assert!(job.encoded_len() <= ANSWER_BYTES);
        let fields: Vec<_> = job.shortened_lists.iter().map(|list| &*list.field_path).collect();
        assert_eq!(fields, ["spec.merge_maps.renamed_clients", "result.merge_maps.map.clients"]);
    }

    #[test]
    fn the_message_of_a_failure_is_cut_between_characters() {
        let message = "ü".repeat(MESSAGE_BYTES);
        let failure = Some(v1::JobFailure { message, ..Default::default() });
        let mut job = v1::Job { failure, ..Default::default() };
        shorten(&mut job);
        let message = job.failure.unwrap().message;
        assert!(message.len() <= MESSAGE_BYTES + 3 && message.ends_with("ü…"));
    }
}
