//! The robot's end: streams at a fixed rate whatever the link does, and looks what became of it.
//!
//! It gives nothing up: a session that ends with an error ends the bench.

use std::io::Read as _;
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

use covis::client::{Client, Credentials, LinkOptions, RetryPolicy, SessionOptions};
use covis::wire::v1;
use flate2::Compression;
use flate2::read::{GzDecoder, GzEncoder};
use prost::Message as _;

use crate::street::{Street, Waits, lock, print_row, send, watch};

/// A walk along the street.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Walk {
    pub(crate) hz: f64,
    pub(crate) minutes: f64,
    pub(crate) observations: usize,
    pub(crate) compress: bool,
}

impl Walk {
    /// Walks to the end, waits for every ack, and compares the map with what was sent.
    pub(crate) async fn run(self, url: &str) -> anyhow::Result<()> {
        let link = LinkOptions { compress: self.compress, ..LinkOptions::default() };
        let client = Client::connect_over(url, &Credentials::default(), link).await?;
        let street = Street::new(self.observations, self.observations / 10);
        let waits = Arc::new(Mutex::new(Waits::default()));
        // Room for a gap, so that the robot never waits; attempts enough for the worst one.
        let retry = RetryPolicy { max_attempts: 1000, ..RetryPolicy::default() };
        let options = SessionOptions {
            max_unanswered: 1024,
            omit_solve_summary: true,
            retry,
            ..SessionOptions::default()
        };
        let policy = v1::MapPolicy::default();
        let mut session = street.begin(&client, "map", policy, options, &waits).await?;
        let watching = tokio::spawn(watch(client.clone(), "map".to_owned(), Arc::clone(&waits)));
        let keyframes = (self.hz * 60.0 * self.minutes) as i64;
        let mut clock = tokio::time::interval(Duration::from_secs_f64(1.0 / self.hz));
        let start = Instant::now();
        for k in 0..keyframes {
            clock.tick().await;
            send(&mut session, &waits, street.keyframe(k)).await?;
        }
        let sent_s = start.elapsed().as_secs_f64();
        let report = session.finish().await?;
        let seconds = start.elapsed().as_secs_f64();
        let told = async {
            while !lock(&waits).told.is_empty() {
                tokio::time::sleep(Duration::from_millis(5)).await;
            }
        };
        let all_told = tokio::time::timeout(Duration::from_secs(60), told).await.is_ok();
        watching.abort();
        check(&client, keyframes).await?;
        println!(
            "{:>20}: {keyframes} keyframes, {} reconnects, {} sent again; sent in {sent_s:.1} s, all \
             durable after {seconds:.1} s: {:.2} a second",
            "robot",
            report.reconnects,
            report.duplicates,
            keyframes as f64 / seconds
        );
        let mut waits = std::mem::take(&mut *lock(&waits));
        print_row("send to RECEIVED", &mut waits.received_s);
        print_row("send to DURABLE", &mut waits.durable_s);
        print_row("send to OPTIMIZED", &mut waits.optimized_s);
        print_row("send to correction", &mut waits.corrected_s);
        anyhow::ensure!(all_told, "corrections are missing");
        anyhow::ensure!(report.rejected == 0, "{:?}", report.rejections);
        Ok(())
    }
}

/// Compares the map's keyframes with those that were sent.
async fn check(client: &Client, keyframes: i64) -> anyhow::Result<()> {
    let poses = client.trajectory("map", None).await?.poses;
    let times: Vec<(i64, i64)> = poses
        .iter()
        .map(|pose| {
            let id = pose.keyframe.as_ref().map_or(-1, |keyframe| keyframe.id);
            (id, pose.capture_time.map_or(-1, |time| time.seconds))
        })
        .collect();
    let lost = (0..keyframes).filter(|k| !times.contains(&(*k, *k))).count();
    let doubled = times.len() as i64 + lost as i64 - keyframes;
    let reordered = times.windows(2).filter(|pair| pair[0].0 >= pair[1].0).count();
    let get = client.get_map("map").await?;
    let next = get.clients.first().map_or(0, |client| client.next_sequence);
    println!("{:>20}: {lost} lost, {doubled} doubled, {reordered} out of order", "keyframes");
    anyhow::ensure!(lost == 0 && doubled == 0 && reordered == 0, "the map is not what was sent");
    anyhow::ensure!(next == keyframes + 2, "the stream goes on at {next}");
    Ok(())
}

/// Bytes and time of a keyframe, plain and compressed as the wire does it.
pub(crate) fn size(observations: usize) -> anyhow::Result<()> {
    let street = Street::new(observations, observations / 10);
    let messages: Vec<Vec<u8>> = (20..220)
        .map(|k| {
            let item = Some(v1::ingest_request::Item::Keyframe(street.keyframe(k)));
            v1::IngestRequest { sequence: k + 2, item }.encode_to_vec()
        })
        .collect();
    let count = messages.len() as f64;
    let mean = |messages: &[Vec<u8>]| messages.iter().map(Vec::len).sum::<usize>() as f64 / count;
    let microseconds = |begin: Instant| begin.elapsed().as_secs_f64() * 1e6 / count;
    println!("{observations} observations: {:.0} bytes a keyframe", mean(&messages));
    // What tonic takes of both, and the fastest.
    type Pack = fn(&[u8]) -> std::io::Result<Vec<u8>>;
    let gzip_back: Pack = |bytes| {
        let mut back = Vec::new();
        GzDecoder::new(bytes).read_to_end(&mut back).map(|_count| back)
    };
    let zstd_back: Pack = |bytes| zstd::decode_all(bytes);
    let ways: [(&str, Pack, Pack); 4] = [
        ("gzip 1", |bytes| gzip(bytes, 1), gzip_back),
        ("gzip 6", |bytes| gzip(bytes, 6), gzip_back),
        ("zstd 1", |bytes| zstd::encode_all(bytes, 1), zstd_back),
        ("zstd 3", |bytes| zstd::encode_all(bytes, 3), zstd_back),
    ];
    for (name, pack, back) in ways {
        let begin = Instant::now();
        let packed: Vec<Vec<u8>> = messages.iter().map(|m| pack(m)).collect::<Result<_, _>>()?;
        let packing = microseconds(begin);
        let begin = Instant::now();
        for message in &packed {
            back(message)?;
        }
        println!(
            "{name}: {:.0} bytes ({:.0} %), {packing:.0} us to compress, {:.0} us back",
            mean(&packed),
            100.0 * mean(&packed) / mean(&messages),
            microseconds(begin)
        );
    }
    Ok(())
}

fn gzip(bytes: &[u8], level: u32) -> std::io::Result<Vec<u8>> {
    let mut packed = Vec::new();
    GzEncoder::new(bytes, Compression::new(level)).read_to_end(&mut packed).map(|_count| packed)
}
