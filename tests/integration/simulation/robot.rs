//! A robot of the simulation: it creates, fills, reads and deletes maps of its own through the client,
//! lets calls be cut off, and holds every answer against what it was told before.
//!
//! A name is in one of three states: absent, present, or unsure after a change whose answer did not
//! come. What was acknowledged must be there; what was refused must have changed nothing; a name
//! whose change has been answered must be either free or a map.

use std::cell::RefCell;
use std::rc::Rc;
use std::time::Duration;

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use tonic::Code;

use super::answer::{Answer, Step, answer, broken};
use super::items::{CAMERA, is_closure, place_m};
use super::sending::{Contents, retries, send};
use super::world::World;
use covis::client::{Client, ClientError, WatchOptions};
use covis::wire::v1;

/// Longest answer to a call that is not cut off.
const PATIENCE: Duration = Duration::from_secs(5);
/// Within this time all that is on its way has arrived.
const SETTLED: Duration = Duration::from_millis(250);
/// How often an answer is asked for, while nothing else goes wrong, before it counts as never to come.
const TRIES: usize = 200;
/// The same, whatever else goes wrong.
const MOST_TRIES: usize = 20 * TRIES;

/// How far a keyframe may be from where it is, meters: starts are exact, landmarks come 0.05 m off.
const FAR_M: f64 = 0.1;

/// What the robot knows of one of its names.
#[derive(Clone, Debug, Default)]
struct Name {
    text: String,
    state: State,
}

#[derive(Clone, Debug, Default)]
enum State {
    #[default]
    Absent,
    /// A creation was begun and not answered.
    Creating,
    Present(Contents),
    /// A deletion was begun and not answered.
    Deleting,
}

/// A robot with its names.
pub(crate) struct Robot {
    client: Client,
    world: Rc<RefCell<World>>,
    rng: ChaCha8Rng,
    names: Vec<Name>,
}

impl Robot {
    pub(crate) fn new(
        number: usize,
        seed: u64,
        client: Client,
        world: &Rc<RefCell<World>>,
    ) -> Self {
        let name = |letter| Name { text: format!("robot-{number}-{letter}"), ..Name::default() };
        let names = vec![name('a'), name('b')];
        let rng = ChaCha8Rng::seed_from_u64(seed ^ (0x9e37_79b9 + number as u64));
        Self { client, world: Rc::clone(world), rng, names }
    }

    /// Does `count` things, one after the other.
    pub(crate) async fn work(&mut self, count: usize) -> Step<()> {
        for _ in 0..count {
            let index = self.rng.random_range(0..self.names.len());
            let mut name = self.names[index].clone();
            let before = format!("{:?}", name.state);
            self.act(&mut name).await?;
            let text = format!("{}: {before} -> {:?}", name.text, name.state);
            self.world.borrow_mut().note(text);
            self.names[index] = name;
        }
        Ok(())
    }

    async fn act(&mut self, name: &mut Name) -> Step<()> {
        let choice = self.rng.random_range(0..100);
        match &name.state {
            State::Absent => match choice {
                0..10 => self.expect_absent(name).await,
                _ => self.create(name).await,
            },
            State::Creating | State::Deleting => self.resolve(name).await,
            State::Present(contents) => match choice {
                0..60 => self.ingest(name).await,
                60..75 => self.audit(name).await,
                75..80 => self.watch(name).await,
                80..85 if !contents.may_be_gone() => self.create(name).await,
                _ => self.delete(name).await,
            },
        }
    }

    /// A call that may be cut off: by its caller, by a deadline, or not at all.
    async fn call<T, F: Future<Output = Result<T, ClientError>>>(
        &mut self,
        call: impl FnOnce(Client) -> F,
    ) -> Answer<T> {
        let micros = self.rng.random_range(500..40_000);
        let short = Duration::from_micros(micros);
        let outcome = match self.rng.random_range(0..4) {
            0 => match tokio::time::timeout(short, call(self.client.clone())).await {
                Ok(outcome) => outcome,
                Err(_cut_off) => return Answer::None,
            },
            1 => call(self.client.with_deadline(short)).await,
            _ => call(self.client.with_deadline(PATIENCE)).await,
        };
        answer(outcome)
    }

    /// A call that is made until it is answered. `None` where the server has crashed meanwhile: what
    /// the answer says of the one before is open then.
    async fn answered<T, F: Future<Output = Result<T, ClientError>>>(
        &self,
        what: &str,
        call: impl Fn(Client) -> F,
    ) -> Step<Answer<T>> {
        let (mut tries, mut before) = (0, self.disturbances());
        for _ in 0..MOST_TRIES {
            if tries >= TRIES {
                break;
            }
            tries = if self.disturbances() == before { tries + 1 } else { 0 };
            before = self.disturbances();
            let outcome = call(self.client.with_deadline(PATIENCE)).await;
            match answer(outcome) {
                // A disk that is full or fails, and a map that needs a restart.
                Answer::None
                | Answer::Refused(
                    Code::Internal | Code::ResourceExhausted | Code::FailedPrecondition,
                    _,
                ) => tokio::time::sleep(Duration::from_millis(20)).await,
                answer @ (Answer::Some(_) | Answer::Refused(..)) => return Ok(answer),
            }
        }
        broken(format!("{what} was never answered"))
    }

    /// How often the server or a link broke down or came back.
    fn disturbances(&self) -> u64 {
        let world = self.world.borrow();
        world.crashes + world.link_changes
    }

    fn crashes(&self) -> u64 {
        self.world.borrow().crashes
    }

    async fn create(&mut self, name: &mut Name) -> Step<()> {
        let text = name.text.clone();
        let outcome =
            self.call(|client| async move { client.create_map(&text, policy(&text)).await });
        match (outcome.await, &name.state) {
            (Answer::Some(map), State::Absent) => {
                let contents = Contents { uid: map.uid, ..Contents::default() };
                name.state = State::Present(contents);
            }
            (Answer::Some(_), State::Present(_)) => {
                return broken(format!("{} was created over a map that is there", name.text));
            }
            (Answer::Refused(Code::AlreadyExists, _), State::Absent) => {
                return broken(format!("{} is taken although it is absent", name.text));
            }
            (Answer::Refused(Code::AlreadyExists | Code::ResourceExhausted, _), _) => {}
            (Answer::None | Answer::Refused(..), State::Absent) => name.state = State::Creating,
            (Answer::None | Answer::Refused(..), _) => {}
            (Answer::Some(_), State::Creating | State::Deleting) => {}
        }
        Ok(())
    }

    async fn delete(&mut self, name: &mut Name) -> Step<()> {
        let text = name.text.clone();
        let outcome = self.call(|client| async move { client.delete_map(&text).await }).await;
        let State::Present(contents) = &mut name.state else { return Ok(()) };
        match outcome {
            Answer::Some(()) => name.state = State::Absent,
            Answer::Refused(Code::NotFound, _) if contents.may_be_gone() => {
                name.state = State::Absent;
            }
            Answer::Refused(Code::NotFound, _) => {
                return broken(format!("{} is gone: {contents:?}", name.text));
            }
            Answer::Refused(Code::ResourceExhausted, _) => {}
            // It failed: what is acknowledged from here on holds all the same.
            Answer::Refused(..) => contents.failed_deletion = Some(contents.durable()),
            Answer::None => name.state = State::Deleting,
        }
        Ok(())
    }

    /// Finds out what became of a change that was not answered.
    async fn resolve(&mut self, name: &mut Name) -> Step<()> {
        tokio::time::sleep(SETTLED).await;
        let crashes = self.crashes();
        let text = &name.text;
        let creates = matches!(name.state, State::Creating) && self.rng.random();
        if creates {
            let created = self
                .answered("CreateMap", |c| async move { c.create_map(text, policy(text)).await });
            match created.await? {
                Answer::Some(map) => {
                    name.state = State::Present(Contents { uid: map.uid, ..Contents::default() });
                }
                Answer::Refused(Code::AlreadyExists, _) => {
                    let found = self.answered("GetMap", |c| async move { c.get_map(text).await });
                    match found.await? {
                        Answer::Some(map) => {
                            let contents = Contents { uid: map.uid, ..Contents::default() };
                            name.state = State::Present(contents);
                        }
                        Answer::Refused(Code::NotFound, _) if self.crashes() == crashes => {
                            return broken(format!("{text} is taken and not found"));
                        }
                        Answer::Refused(..) | Answer::None => {}
                    }
                }
                other @ (Answer::Refused(..) | Answer::None) => {
                    return broken(format!("{text}: CreateMap answered {other:?}"));
                }
            }
            return Ok(());
        }
        self.world.borrow_mut().note(format!("{text} is to be deleted"));
        let deleted = self.answered("DeleteMap", |c| async move { c.delete_map(text).await });
        match deleted.await? {
            Answer::Some(()) | Answer::Refused(Code::NotFound, _) => name.state = State::Absent,
            other @ (Answer::Refused(..) | Answer::None) => {
                return broken(format!("{text}: DeleteMap answered {other:?}"));
            }
        }
        Ok(())
    }

    async fn expect_absent(&mut self, name: &Name) -> Step<()> {
        let text = name.text.clone();
        match self.call(|client| async move { client.get_map(&text).await }).await {
            Answer::Some(map) => broken(format!("{} is back: {}", name.text, map.uid)),
            Answer::Refused(..) | Answer::None => Ok(()),
        }
    }

    /// Sends some items, those again that are not known to be durable first.
    async fn ingest(&mut self, name: &mut Name) -> Step<()> {
        let patience = Duration::from_micros(self.rng.random_range(500..300_000));
        let new = self.rng.random_range(1..24);
        let pause = self.rng.random_range(0..3);
        let State::Present(contents) = &mut name.state else { return Ok(()) };
        let first = contents.durable() + 1;
        contents.sent += new;
        let sending = send(self.client.clone(), name.text.clone(), contents.clone(), first, pause);
        match tokio::time::timeout(patience, sending).await {
            Err(_cut_off) => Ok(()),
            Ok(outcome) => match outcome? {
                Answer::Refused(Code::NotFound, _) if contents.may_be_gone() => {
                    name.state = State::Absent;
                    Ok(())
                }
                Answer::Refused(Code::NotFound, text) => {
                    broken(format!("{} is gone ({text}): {contents:?}", name.text))
                }
                Answer::Some(()) | Answer::Refused(..) | Answer::None => Ok(()),
            },
        }
    }

    /// Holds the map against what was acknowledged.
    async fn audit(&mut self, name: &mut Name) -> Step<()> {
        let State::Present(contents) = &name.state else { return Ok(()) };
        let (text, durable) = (name.text.clone(), contents.durable());
        let found = self
            .call(|client| async move {
                let map = client.get_map(&text).await?;
                let trajectory = client.trajectory(&text, None).await?;
                Ok((map, trajectory, client.constraints(&text).await?))
            })
            .await;
        let (map, trajectory, constraints) = match found {
            Answer::Some(found) => found,
            Answer::Refused(Code::NotFound, _) if contents.may_be_gone() => {
                name.state = State::Absent;
                return Ok(());
            }
            Answer::Refused(Code::NotFound, text) => {
                return broken(format!("{} is gone ({text}): {contents:?}", name.text));
            }
            Answer::Refused(..) | Answer::None => return Ok(()),
        };
        if map.uid != contents.uid {
            return broken(format!("{} is another map: {map:?}, {contents:?}", name.text));
        }
        let sent = contents.sent.max(CAMERA);
        let keyframes = trajectory.poses.iter().filter_map(|pose| pose.keyframe.as_ref());
        let keyframes: Vec<i64> = keyframes.map(|keyframe| keyframe.id).collect();
        let closures = constraints.constraints.iter().filter_map(closure_id);
        // The server's own have ids below 0.
        let closures: Vec<i64> = closures.filter(|&id| id > 0).collect();
        for (what, ids, is_kind) in [
            ("keyframes", keyframes, (|id| !is_closure(id)) as fn(i64) -> bool),
            ("closures", closures, is_closure),
        ] {
            let newest = ids.last().copied().unwrap_or(CAMERA);
            if !ids.iter().copied().eq((CAMERA + 1..=newest).filter(|&id| is_kind(id))) {
                let text = format!("{}: {what} lost, doubled or out of order", name.text);
                return broken(format!("{text}: {ids:?}"));
            }
            let acknowledged = (CAMERA + 1..=durable).filter(|&id| is_kind(id)).count();
            if ids.len() < acknowledged || newest > sent {
                return broken(format!("{}: {what} {ids:?} of {contents:?}", name.text));
            }
        }
        self.check_poses(name, &trajectory.poses)
    }

    /// What robots measure is exact: whatever is solved and wherever it is cut off, no keyframe is far
    /// from where it is.
    fn check_poses(&self, name: &Name, poses: &[v1::KeyframePose]) -> Step<()> {
        for pose in poses {
            let position = pose.world_from_camera.as_ref().and_then(|pose| pose.translation);
            let (Some(v1::Vector3 { x, y, z }), Some(keyframe)) = (position, &pose.keyframe) else {
                return broken(format!("{}: a keyframe without a pose", name.text));
            };
            let off = (x - place_m(keyframe.id)).hypot(y).hypot(z);
            // NaN is far off as well.
            if off.is_nan() || off > FAR_M {
                return broken(format!("{}: keyframe {} is {off} m off", name.text, keyframe.id));
            }
        }
        Ok(())
    }

    /// Follows the map from its beginning, and holds what is told against what was acknowledged.
    async fn watch(&mut self, name: &Name) -> Step<()> {
        let State::Present(contents) = &name.state else { return Ok(()) };
        let (text, durable) = (name.text.clone(), contents.durable());
        let acknowledged = (CAMERA + 1..=durable).filter(|&id| !is_closure(id)).count();
        let watched = self.call(|client| async move {
            let options = WatchOptions { retry: retries(), ..WatchOptions::default() };
            let mut watch = client.watch(&text, options).await?;
            Ok(watch.next().await?.keyframes.len())
        });
        match watched.await {
            Answer::Some(count) if count < acknowledged => {
                broken(format!("{}: a watcher sees {count} of {acknowledged}", name.text))
            }
            Answer::Some(_) | Answer::Refused(..) | Answer::None => Ok(()),
        }
    }

    /// With a server that is up and links that hold: each name is a map with all that was
    /// acknowledged, or free.
    pub(crate) async fn finish(&mut self) -> Step<()> {
        for index in 0..self.names.len() {
            let mut name = self.names[index].clone();
            while matches!(name.state, State::Creating | State::Deleting) {
                self.resolve(&mut name).await?;
            }
            let text = &name.text;
            let found = self.answered("GetMap", |c| async move { c.get_map(text).await }).await?;
            match (&name.state, found) {
                (State::Absent, Answer::Refused(Code::NotFound, _)) => {}
                (State::Present(contents), Answer::Refused(Code::NotFound, _))
                    if contents.may_be_gone() =>
                {
                    name.state = State::Absent;
                }
                (State::Present(_), Answer::Some(_)) => {
                    self.audit_surely(&mut name).await?;
                    self.expect_searched(&name).await?;
                    self.expect_adjusted(&name).await?;
                }
                (state, Answer::Some(map)) => {
                    return broken(format!("{text}: {state:?}, found {}", map.uid));
                }
                (state, found) => return broken(format!("{text}: {state:?}, found {found:?}")),
            }
            self.names[index] = name;
        }
        Ok(())
    }

    /// What follows closures is done in the end, although it was cut off.
    async fn expect_adjusted(&mut self, name: &Name) -> Step<()> {
        let text = &name.text;
        for _ in 0..TRIES {
            let found = self.answered("GetMap", |c| async move { c.get_map(text).await }).await?;
            let Answer::Some(map) = found else { return Ok(()) };
            if !map.adjustment_due {
                let landmarks = self
                    .answered("ListLandmarks", |c| async move { c.landmarks(text).await })
                    .await?;
                if let Answer::Some(all) = landmarks {
                    let joined = all.landmarks.iter().filter(|l| l.duplicate_of.is_some()).count();
                    self.world.borrow_mut().joined += joined as u64;
                }
                return Ok(());
            }
            tokio::time::sleep(SETTLED).await;
        }
        broken(format!("{text} is never adjusted after its closures"))
    }

    /// The place of each keyframe is searched in the end, although searches were cut off, and each closure
    /// that a search found is in the map once.
    async fn expect_searched(&mut self, name: &Name) -> Step<()> {
        let text = &name.text;
        for _ in 0..TRIES {
            let found = self.answered("ListPlaceSearches", |c| async move {
                // In this order: what is searched by then is among the constraints.
                let keyframes = c.trajectory(text, None).await?.poses.len();
                let searches = c.place_searches(text).await?.searches;
                Ok((keyframes, searches, c.constraints(text).await?))
            });
            let Answer::Some((keyframes, searches, constraints)) = found.await? else {
                return Ok(());
            };
            let mut closures: Vec<i64> =
                searches.iter().filter_map(|search| Some(search.closure.as_ref()?.id)).collect();
            let own = constraints.constraints.iter().filter_map(closure_id);
            let mut own: Vec<i64> = own.filter(|&id| id < 0).collect();
            closures.sort_unstable();
            own.sort_unstable();
            if searches.len() == keyframes {
                if closures != own {
                    return broken(format!(
                        "{text}: searches found {closures:?}, there are {own:?}"
                    ));
                }
                self.world.borrow_mut().found += own.len() as u64;
                return Ok(());
            }
            tokio::time::sleep(SETTLED).await;
        }
        broken(format!("{text}: the places of some keyframes are never searched"))
    }

    async fn audit_surely(&mut self, name: &mut Name) -> Step<()> {
        // One in two calls may not be answered.
        for _ in 0..8 {
            self.audit(name).await?;
        }
        Ok(())
    }
}

/// The id of a loop closure.
fn closure_id(constraint: &v1::Constraint) -> Option<i64> {
    match &constraint.constraint {
        Some(v1::constraint::Constraint::RelativePose(closure)) => Some(closure.id),
        Some(_) | None => None,
    }
}

/// Windows are solved in one of a robot's two maps.
fn policy(name: &str) -> Option<v1::MapPolicy> {
    let local_bundle_adjustment = Some(name.ends_with('a'));
    Some(v1::MapPolicy { local_bundle_adjustment, ..v1::MapPolicy::default() })
}
