//! Which topics of a recording are color, depth and camera: those that are named, else the best by type,
//! encoding and the names that ROS 2 drivers give. Where two are equally good, the caller must choose.
//!
//! It reads no message.

use std::fmt;
use std::path::Path;

use super::error::RecordingError;
use super::index::Topic;
use super::messages::Kind;
use super::{images, poses};

/// What a topic is used for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Role {
    /// Color images.
    Color,
    /// Depth images, registered to color.
    Depth,
    /// The camera of both.
    Camera,
    /// Poses.
    Trajectory,
    /// Odometry of the camera's robot.
    Odometry,
}

impl Role {
    /// The argument that names its topic.
    pub(super) fn option(self) -> &'static str {
        match self {
            Self::Color => "--color-topic",
            Self::Depth => "--depth-topic",
            Self::Camera => "--camera-info-topic",
            Self::Trajectory => "PATH:TOPIC",
            Self::Odometry => "--odometry",
        }
    }

    /// What a topic for it must be.
    pub(super) fn wanted(self) -> &'static str {
        match self {
            Self::Color => {
                "sensor_msgs/msg/Image with rgb8, bgr8, rgba8, bgra8 or mono8, or \
                 sensor_msgs/msg/CompressedImage with JPEG or PNG"
            }
            Self::Depth => {
                "sensor_msgs/msg/Image with 16UC1 or 32FC1, or sensor_msgs/msg/CompressedImage with \
                 compressedDepth, or sensor_msgs/msg/PointCloud2 with rows (height above 1)"
            }
            Self::Camera => "sensor_msgs/msg/CameraInfo; --camera gives the numbers instead",
            Self::Trajectory => {
                "nav_msgs/msg/Odometry, or PoseStamped, PoseWithCovarianceStamped or TransformStamped of \
                 geometry_msgs"
            }
            Self::Odometry => "nav_msgs/msg/Odometry or geometry_msgs/msg/TransformStamped",
        }
    }

    /// Whether a topic can have it.
    fn fits(self, topic: &Topic) -> bool {
        let encoding = &topic.sample.encoding;
        match (self, topic.kind) {
            (Self::Color, Kind::Image) => images::is_color(encoding),
            (Self::Color, Kind::CompressedImage) => !images::is_compressed_depth(encoding),
            (Self::Depth, Kind::Image) => images::is_depth(encoding),
            (Self::Depth, Kind::CompressedImage) => images::is_compressed_depth(encoding),
            // Points in rows are pixels.
            (Self::Depth, Kind::PointCloud) => topic.sample.size.is_some_and(|(_, rows)| rows > 1),
            (Self::Camera, Kind::CameraInfo) | (Self::Trajectory, Kind::Pose) => true,
            (Self::Odometry, Kind::Pose) => poses::names_body(&topic.type_name),
            (
                _,
                Kind::Image
                | Kind::CompressedImage
                | Kind::CameraInfo
                | Kind::PointCloud
                | Kind::Pose
                | Kind::StaticTransforms
                | Kind::Other,
            ) => false,
        }
    }
}

impl fmt::Display for Role {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Color => "color",
            Self::Depth => "depth",
            Self::Camera => "the camera",
            Self::Trajectory => "a trajectory",
            Self::Odometry => "odometry",
        })
    }
}

/// A topic as the caller sees it.
#[derive(Clone, Debug, PartialEq)]
pub struct TopicSummary {
    /// Its name.
    pub name: String,
    /// The type of its messages, such as `sensor_msgs/msg/Image`.
    pub type_name: String,
    /// How its messages are encoded: `cdr`, or something that is not read.
    pub serialization: String,
    /// How many messages there are.
    pub count: u64,
    /// The encoding or format of its images.
    pub pixels: String,
    /// Columns and rows, where its first message tells them.
    pub size: Option<(usize, usize)>,
}

impl TopicSummary {
    /// Why a run uses no messages of its type, where people expect that it does; for the log of a run.
    #[must_use]
    pub fn reason_unused(&self) -> Option<&'static str> {
        match &*self.type_name {
            "sensor_msgs/msg/Imu" => Some("the server takes no inertial measurements"),
            "nav_msgs/msg/Odometry" => Some("--odometry names the topic that a run is to use"),
            "sensor_msgs/msg/NavSatFix" => Some("a run sends no positions of satellites"),
            _ => None,
        }
    }
}

impl fmt::Display for TopicSummary {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { name, type_name, serialization, count, pixels, size } = self;
        let plural = if *count == 1 { "" } else { "s" };
        write!(f, "{name}: {type_name}, {count} message{plural}")?;
        if !["cdr", "protobuf"].contains(&serialization.as_str()) {
            write!(f, " in {serialization}, which is not read")?;
        }
        if !pixels.is_empty() {
            write!(f, ", {pixels}")?;
        }
        size.map_or(Ok(()), |(width, height)| write!(f, ", {width}x{height}"))
    }
}

/// What the caller names.
#[derive(Clone, Copy, Debug, Default)]
pub struct TopicNames<'a> {
    /// The topic of color.
    pub color: Option<&'a str>,
    /// The topic of depth.
    pub depth: Option<&'a str>,
    /// The topic of the camera.
    pub camera_info: Option<&'a str>,
    /// The topic of odometry; none is used where none is named.
    pub odometry: Option<&'a str>,
}

/// The topics of color and depth.
pub(super) fn images<'a>(
    path: &Path,
    topics: &'a [Topic],
    names: TopicNames<'_>,
) -> Result<(&'a Topic, &'a Topic), RecordingError> {
    let color = choose(path, topics, Role::Color, names.color, color_score)?;
    let score = |topic: &Topic| depth_score(topic, color);
    Ok((color, choose(path, topics, Role::Depth, names.depth, score)?))
}

/// The topic of a trajectory: the named one, else the only one that has poses.
pub(super) fn trajectory<'a>(
    path: &Path,
    topics: &'a [Topic],
    named: Option<&str>,
) -> Result<&'a Topic, RecordingError> {
    choose(path, topics, Role::Trajectory, named, |_| 0)
}

/// The named topic of odometry.
pub(super) fn odometry<'a>(
    path: &Path,
    topics: &'a [Topic],
    named: &str,
) -> Result<&'a Topic, RecordingError> {
    choose(path, topics, Role::Odometry, Some(named), |_| 0)
}

/// The topic of a camera: the named one, else `camera_info` beside the images, else the only one.
pub(super) fn camera_info<'a>(
    path: &Path,
    topics: &'a [Topic],
    images: &Topic,
    named: Option<&str>,
) -> Result<&'a Topic, RecordingError> {
    if named.is_none()
        && let Some(beside) = info_beside(topics, images)
    {
        return Ok(beside);
    }
    let score = |topic: &Topic| {
        i32::from(topic.sample.frame_id == images.sample.frame_id) * 2
            + i32::from(topic.sample.size == images.sample.size)
    };
    choose(path, topics, Role::Camera, named, score)
}

/// The topic `camera_info` beside the images: of `a/image_raw/compressed` it is `a/camera_info`.
pub(super) fn info_beside<'a>(topics: &'a [Topic], images: &Topic) -> Option<&'a Topic> {
    let mut parent = images.name.rsplit_once('/')?.0;
    loop {
        let beside = |t: &&Topic| {
            Role::Camera.fits(t) && t.name.strip_prefix(parent) == Some("/camera_info")
        };
        if let Some(found) = topics.iter().find(beside) {
            return Some(found);
        }
        // The root's belongs to no camera in particular.
        parent = parent.rsplit_once('/').filter(|(above, _)| !above.is_empty())?.0;
    }
}

/// The named topic, else the only one with the highest score.
fn choose<'a>(
    path: &Path,
    topics: &'a [Topic],
    role: Role,
    named: Option<&str>,
    score: impl Fn(&Topic) -> i32,
) -> Result<&'a Topic, RecordingError> {
    let path = path.to_owned();
    let summaries =
        |topics: &mut dyn Iterator<Item = &Topic>| topics.map(Topic::summary).collect::<Vec<_>>();
    let fitting = || topics.iter().filter(|topic| topic.count > 0 && role.fits(topic));
    if let Some(name) = named {
        return fitting().find(|topic| topic.name == name).ok_or_else(|| {
            let topics = summaries(&mut topics.iter());
            RecordingError::NotThisTopic { path, named: name.to_owned(), role, topics }
        });
    }
    let Some(best) = fitting().map(&score).max() else {
        let topics = summaries(&mut topics.iter());
        return Err(RecordingError::NoTopic { path, role, topics });
    };
    let mut candidates = fitting().filter(|topic| score(topic) == best);
    match (candidates.next(), candidates.next()) {
        (Some(only), None) => Ok(only),
        _ => {
            let candidates = summaries(&mut fitting().filter(|topic| score(topic) == best));
            Err(RecordingError::Ambiguous { path, role, candidates })
        }
    }
}

/// Color goes before gray, and what is called color before infrared; raw before compressed.
fn color_score(topic: &Topic) -> i32 {
    let name = topic.name.to_lowercase();
    let has = |words: &[&str]| i32::from(words.iter().any(|word| name.contains(word)));
    8 * i32::from(topic.sample.encoding != "mono8") + 4 * has(&["color", "rgb"])
        - 4 * has(&["infra", "/ir/", "depth", "mask"])
        + is_raw(topic)
}

/// Images go before point clouds.
/// What drivers call registered goes first, then what has the frame and the size of color; raw before
/// compressed.
fn depth_score(topic: &Topic, color: &Topic) -> i32 {
    let name = topic.name.to_lowercase();
    let is_registered =
        ["aligned", "registered", "_to_color", "_to_rgb"].iter().any(|w| name.contains(w));
    let has_frame = topic.sample.frame_id == color.sample.frame_id;
    let has_size = topic.sample.size.is_some() && topic.sample.size == color.sample.size;
    16 * i32::from(topic.kind != Kind::PointCloud)
        + 8 * i32::from(is_registered)
        + 4 * i32::from(has_frame)
        + 2 * i32::from(has_size)
        + is_raw(topic)
}

fn is_raw(topic: &Topic) -> i32 {
    i32::from(topic.kind == Kind::Image)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::input::recording::messages::Sample;

    fn topic(name: &str, kind: Kind, encoding: &str, frame_id: &str) -> Topic {
        let type_name = match kind {
            Kind::Image => "sensor_msgs/msg/Image",
            Kind::CompressedImage => "sensor_msgs/msg/CompressedImage",
            Kind::CameraInfo => "sensor_msgs/msg/CameraInfo",
            Kind::Pose => "nav_msgs/msg/Odometry",
            Kind::PointCloud => "sensor_msgs/msg/PointCloud2",
            Kind::StaticTransforms => "tf2_msgs/msg/TFMessage",
            Kind::Other => "sensor_msgs/msg/Imu",
        };
        let sample = Sample {
            frame_id: frame_id.to_owned(),
            encoding: encoding.to_owned(),
            size: (kind != Kind::CompressedImage).then_some((640, 480)),
        };
        Topic {
            name: name.to_owned(),
            type_name: type_name.to_owned(),
            encoding: "cdr".to_owned(),
            kind,
            count: 3,
            messages: Vec::new(),
            sample,
        }
    }

    #[test]
    fn points_in_rows_are_depth_where_no_image_is() {
        let color = topic("/cam/image_raw", Kind::Image, "rgb8", "optical");
        let cloud = topic("/cam/depth_registered/points", Kind::PointCloud, "", "optical");
        let mut lidar = topic("/lidar/points", Kind::PointCloud, "", "lidar");
        lidar.sample.size = Some((65_536, 1));
        let depth = topic("/cam/depth", Kind::Image, "16UC1", "depth");
        let chosen = |topics: &[Topic], named| {
            let names = TopicNames { depth: named, ..TopicNames::default() };
            images(Path::new("a"), topics, names).map(|(_, depth)| depth.name.clone())
        };
        let mut topics = vec![color, cloud, lidar];
        assert_eq!(chosen(&topics, None).unwrap(), "/cam/depth_registered/points");
        let error = chosen(&topics, Some("/lidar/points")).unwrap_err().to_string();
        assert!(error.contains("height above 1") && error.contains("65536x1"), "{error}");
        topics.push(depth);
        assert_eq!(chosen(&topics, None).unwrap(), "/cam/depth");
        let named = Some("/cam/depth_registered/points");
        assert_eq!(chosen(&topics, named).ok().as_deref(), named);
    }

    /// What a RealSense driver records.
    fn realsense() -> Vec<Topic> {
        vec![
            topic("/camera/aligned_depth_to_color/camera_info", Kind::CameraInfo, "", "color"),
            topic("/camera/aligned_depth_to_color/image_raw", Kind::Image, "16UC1", "color"),
            topic("/camera/color/camera_info", Kind::CameraInfo, "", "color"),
            topic("/camera/color/image_raw", Kind::Image, "rgb8", "color"),
            topic(
                "/camera/color/image_raw/compressed",
                Kind::CompressedImage,
                "rgb8; jpeg",
                "color",
            ),
            topic("/camera/depth/image_rect_raw", Kind::Image, "16UC1", "depth"),
            topic("/camera/imu", Kind::Other, "", ""),
            topic("/camera/infra1/image_rect_raw", Kind::Image, "mono8", "infra"),
            topic("/camera/infra2/image_rect_raw", Kind::Image, "mono8", "infra"),
        ]
    }

    fn chosen(topics: &[Topic], names: TopicNames<'_>) -> Result<[String; 3], RecordingError> {
        let path = Path::new("bag");
        let (color, depth) = images(path, topics, names)?;
        let info = camera_info(path, topics, color, names.camera_info)?;
        Ok([color, depth, info].map(|topic| topic.name.clone()))
    }

    #[test]
    fn a_drivers_topics_are_found_by_type_encoding_and_name() {
        let expected = [
            "/camera/color/image_raw",
            "/camera/aligned_depth_to_color/image_raw",
            "/camera/color/camera_info",
        ];
        assert_eq!(chosen(&realsense(), TopicNames::default()).unwrap(), expected);
        // Without the raw ones the compressed image is color, and its camera is two above it.
        let mut topics = realsense();
        topics.retain(|topic| topic.name != expected[0]);
        let found = chosen(&topics, TopicNames::default()).unwrap();
        assert_eq!(found[0], "/camera/color/image_raw/compressed");
        assert_eq!(found[2], expected[2]);
        let names =
            TopicNames { depth: Some("/camera/depth/image_rect_raw"), ..TopicNames::default() };
        assert_eq!(chosen(&realsense(), names).unwrap()[1], "/camera/depth/image_rect_raw");
    }

    #[test]
    fn what_is_missing_or_equally_good_is_told_with_the_topics() {
        let two =
            [topic("/a/rgb", Kind::Image, "rgb8", "x"), topic("/b/rgb", Kind::Image, "rgb8", "x")];
        let error = chosen(&two, TopicNames::default()).unwrap_err().to_string();
        assert!(
            error.contains("--color-topic") && error.contains("; /b/rgb: sensor_msgs/msg/Image, 3")
        );
        let error = chosen(&two[..1], TopicNames::default()).unwrap_err().to_string();
        assert!(error.contains("no topic for depth") && error.contains("/a/rgb"), "{error}");
        let names = TopicNames { color: Some("/camera/imu"), ..TopicNames::default() };
        let error = chosen(&realsense(), names).unwrap_err().to_string();
        assert!(error.contains("`/camera/imu` is not a topic for color"), "{error}");
        let error = chosen(&[], TopicNames::default()).unwrap_err().to_string();
        assert!(error.contains("there are no topics"), "{error}");
    }
}
