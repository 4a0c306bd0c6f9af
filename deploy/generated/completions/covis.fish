# Print an optspec for argparse to handle cmd's options that are independent of any subcommand.
function __fish_covis_global_optspecs
    string join \n config= log= log-format= h/help V/version
end

function __fish_covis_needs_command
    # Figure out if the current invocation already has a command.
    set -l cmd (commandline -opc)
    set -e cmd[1]
    argparse -s (__fish_covis_global_optspecs) -- $cmd 2>/dev/null
    or return
    if set -q argv[1]
        # Also print the command, so this can be used to figure out what it is.
        echo $argv[1]
        return 1
    end
    return 0
end

function __fish_covis_using_subcommand
    set -l cmd (__fish_covis_needs_command)
    test -z "$cmd"
    and return 1
    contains -- $cmd[1] $argv
end

complete -c covis -n "__fish_covis_needs_command" -l config -d 'Configuration file instead of ./covis.toml [env: COVIS_CONFIG]' -r -F
complete -c covis -n "__fish_covis_needs_command" -l log -d 'Log level (off, error, warn, info, debug, trace) or a list of them, `target=level` [default: info; warn of commands that do not write to a terminal] [env: COVIS_LOG]' -r
complete -c covis -n "__fish_covis_needs_command" -l log-format -d 'Format of log lines [default: text] [env: COVIS_LOG_FORMAT]' -r -f -a "text\t'For people'
json\t'One JSON object a line'"
complete -c covis -n "__fish_covis_needs_command" -s h -l help -d 'Print help (see more with \'--help\')'
complete -c covis -n "__fish_covis_needs_command" -s V -l version -d 'Print version'
complete -c covis -n "__fish_covis_needs_command" -f -a "doctor" -d 'Check a data directory without a server: verify, report, repair'
complete -c covis -n "__fish_covis_needs_command" -f -a "backup" -d 'Copy a data directory, even while a server uses it'
complete -c covis -n "__fish_covis_needs_command" -f -a "convert" -d 'Write a file in another format: trajectories, bundle adjustment, pose graphs'
complete -c covis -n "__fish_covis_needs_command" -f -a "eval" -d 'Compare trajectories: absolute (APE) or relative pose error (RPE)'
complete -c covis -n "__fish_covis_needs_command" -f -a "fuse" -d 'Fuse recorded depth and color images into a surface, at given poses'
complete -c covis -n "__fish_covis_needs_command" -f -a "mesh" -d 'Write the surface of a stored volume as PLY or GLB'
complete -c covis -n "__fish_covis_needs_command" -f -a "grid" -d 'Write a navigation grid from a stored volume: occupancy (PGM, YAML) or distances (PFM)'
complete -c covis -n "__fish_covis_needs_command" -f -a "bench-frontend" -d 'Measure the reference frontend on sequences with ground truth, with and without the mask'
complete -c covis -n "__fish_covis_needs_command" -f -a "demo" -d 'Track a camera in a synthetic room in which people walk, with and without the mask, on its own server'
complete -c covis -n "__fish_covis_needs_command" -f -a "synth" -d 'Write synthetic data with ground truth'
complete -c covis -n "__fish_covis_needs_command" -f -a "completions" -d 'Write the completions of a shell, for its startup file or its folder of completions'
complete -c covis -n "__fish_covis_needs_command" -f -a "health" -d 'Check whether a server is ready; the exit code is 0 if it is'
complete -c covis -n "__fish_covis_needs_command" -f -a "job" -d 'Submit, list, show, watch, cancel or delete the jobs of a server'
complete -c covis -n "__fish_covis_needs_command" -f -a "load" -d 'Put a server under load: several maps, each with a client that sends keyframes at a fixed rate'
complete -c covis -n "__fish_covis_needs_command" -f -a "map" -d 'List, show, create, change, copy, restore, export, import or delete the maps of a server'
complete -c covis -n "__fish_covis_needs_command" -f -a "record" -d 'Record a map as MCAP, for Foxglove and Rerun'
complete -c covis -n "__fish_covis_needs_command" -f -a "replay" -d 'Stream a BAL file or a COLMAP folder to a server, as a frontend would, then optimize the map'
complete -c covis -n "__fish_covis_needs_command" -f -a "run" -d 'Track an RGB-D sequence with the reference frontend, through a server'
complete -c covis -n "__fish_covis_needs_command" -f -a "serve" -d 'Serve maps over gRPC until SIGTERM or ctrl-c'
complete -c covis -n "__fish_covis_needs_command" -f -a "worker" -d 'Solve problem files of servers\' jobs until SIGTERM or ctrl-c, in builds with the feature `cluster`'
complete -c covis -n "__fish_covis_needs_command" -f -a "solve" -d 'Solve a file: bundle adjustment or pose graph. `covis solve FILE` sees which it is'
complete -c covis -n "__fish_covis_needs_command" -f -a "help" -d 'Print this message or the help of the given subcommand(s)'
complete -c covis -n "__fish_covis_using_subcommand doctor" -l config -d 'Configuration file instead of ./covis.toml [env: COVIS_CONFIG]' -r -F
complete -c covis -n "__fish_covis_using_subcommand doctor" -l log -d 'Log level (off, error, warn, info, debug, trace) or a list of them, `target=level` [default: info; warn of commands that do not write to a terminal] [env: COVIS_LOG]' -r
complete -c covis -n "__fish_covis_using_subcommand doctor" -l log-format -d 'Format of log lines [default: text] [env: COVIS_LOG_FORMAT]' -r -f -a "text\t'For people'
json\t'One JSON object a line'"
complete -c covis -n "__fish_covis_using_subcommand doctor" -l repair -d 'Set damaged files aside, so that their maps continue from what was recovered; nothing is deleted. Jobs are left as they are: the server does not list a damaged one'
complete -c covis -n "__fish_covis_using_subcommand doctor" -l cut -d 'With --repair: if an event of a journal is intact but cannot be read, drop it and all later events, and list them. The files are set aside; nothing is deleted'
complete -c covis -n "__fish_covis_using_subcommand doctor" -l json -d 'Print one JSON object instead of text'
complete -c covis -n "__fish_covis_using_subcommand doctor" -s h -l help -d 'Print help (see more with \'--help\')'
complete -c covis -n "__fish_covis_using_subcommand backup" -l config -d 'Configuration file instead of ./covis.toml [env: COVIS_CONFIG]' -r -F
complete -c covis -n "__fish_covis_using_subcommand backup" -l log -d 'Log level (off, error, warn, info, debug, trace) or a list of them, `target=level` [default: info; warn of commands that do not write to a terminal] [env: COVIS_LOG]' -r
complete -c covis -n "__fish_covis_using_subcommand backup" -l log-format -d 'Format of log lines [default: text] [env: COVIS_LOG_FORMAT]' -r -f -a "text\t'For people'
json\t'One JSON object a line'"
complete -c covis -n "__fish_covis_using_subcommand backup" -l json -d 'Print one JSON object instead of text'
complete -c covis -n "__fish_covis_using_subcommand backup" -s h -l help -d 'Print help (see more with \'--help\')'
complete -c covis -n "__fish_covis_using_subcommand convert" -l from -d 'Format of the input [default: detected from its name or its first line]' -r -f -a "tum\t'TUM trajectory'
kitti\t'KITTI odometry poses'
euroc\t'EuRoC (ASL) ground truth'
bal\t'bundle adjustment in the large'
bundler\t'Bundler, with its list of images'
colmap-text\t'folder with COLMAP\'s sparse model'
colmap-binary\t'folder with COLMAP\'s sparse model'
openmvg\t'OpenMVG\'s sfm_data.json'
g2o\t'pose graph'
pyfg\t'PyFactorGraph\'s pose graph with ranges'"
complete -c covis -n "__fish_covis_using_subcommand convert" -l to -d 'Format of the output: tum, kitti, euroc, bal, bundler, colmap-text, colmap-binary, g2o, pyfg or ply [default: by its name; a name without extension is a COLMAP folder]' -r -f -a "tum\t'TUM trajectory'
kitti\t'KITTI odometry poses'
euroc\t'EuRoC (ASL) ground truth'
bal\t'bundle adjustment in the large'
bundler\t'Bundler, with its list of images'
colmap-text\t'folder with COLMAP\'s sparse model'
colmap-binary\t'folder with COLMAP\'s sparse model'
g2o\t'pose graph'
pyfg\t'PyFactorGraph\'s pose graph with ranges'
ply\t'points and paths for viewers'"
complete -c covis -n "__fish_covis_using_subcommand convert" -l times -d 'Times of the poses of a KITTI file, seconds, one per line' -r -F
complete -c covis -n "__fish_covis_using_subcommand convert" -l robot -d 'The robot of a pyfg file whose trajectory is written, by the letter of its poses; needed if the file has several' -r
complete -c covis -n "__fish_covis_using_subcommand convert" -l config -d 'Configuration file instead of ./covis.toml [env: COVIS_CONFIG]' -r -F
complete -c covis -n "__fish_covis_using_subcommand convert" -l log -d 'Log level (off, error, warn, info, debug, trace) or a list of them, `target=level` [default: info; warn of commands that do not write to a terminal] [env: COVIS_LOG]' -r
complete -c covis -n "__fish_covis_using_subcommand convert" -l log-format -d 'Format of log lines [default: text] [env: COVIS_LOG_FORMAT]' -r -f -a "text\t'For people'
json\t'One JSON object a line'"
complete -c covis -n "__fish_covis_using_subcommand convert" -l force -d 'Replace files that are there'
complete -c covis -n "__fish_covis_using_subcommand convert" -l skip-unknown -d 'Skip the lines of a g2o or pyfg file that covis does not read, and say how many of each tag. Without this flag such a line is an error'
complete -c covis -n "__fish_covis_using_subcommand convert" -l json -d 'Print one JSON object instead of a sentence'
complete -c covis -n "__fish_covis_using_subcommand convert" -s h -l help -d 'Print help (see more with \'--help\')'
complete -c covis -n "__fish_covis_using_subcommand eval; and not __fish_seen_subcommand_from ape rpe mask truth help" -l config -d 'Configuration file instead of ./covis.toml [env: COVIS_CONFIG]' -r -F
complete -c covis -n "__fish_covis_using_subcommand eval; and not __fish_seen_subcommand_from ape rpe mask truth help" -l log -d 'Log level (off, error, warn, info, debug, trace) or a list of them, `target=level` [default: info; warn of commands that do not write to a terminal] [env: COVIS_LOG]' -r
complete -c covis -n "__fish_covis_using_subcommand eval; and not __fish_seen_subcommand_from ape rpe mask truth help" -l log-format -d 'Format of log lines [default: text] [env: COVIS_LOG_FORMAT]' -r -f -a "text\t'For people'
json\t'One JSON object a line'"
complete -c covis -n "__fish_covis_using_subcommand eval; and not __fish_seen_subcommand_from ape rpe mask truth help" -s h -l help -d 'Print help (see more with \'--help\')'
complete -c covis -n "__fish_covis_using_subcommand eval; and not __fish_seen_subcommand_from ape rpe mask truth help" -f -a "ape" -d 'Absolute pose error of aligned trajectories'
complete -c covis -n "__fish_covis_using_subcommand eval; and not __fish_seen_subcommand_from ape rpe mask truth help" -f -a "rpe" -d 'Relative pose error from one matched pose to the next, or over a number of poses, a path, an angle or a time'
complete -c covis -n "__fish_covis_using_subcommand eval; and not __fish_seen_subcommand_from ape rpe mask truth help" -f -a "mask" -d 'Intersection over union of masks of moving objects, and the share that they mask falsely'
complete -c covis -n "__fish_covis_using_subcommand eval; and not __fish_seen_subcommand_from ape rpe mask truth help" -f -a "truth" -d 'Write the ground-truth poses beside recorded images as a trajectory'
complete -c covis -n "__fish_covis_using_subcommand eval; and not __fish_seen_subcommand_from ape rpe mask truth help" -f -a "help" -d 'Print this message or the help of the given subcommand(s)'
complete -c covis -n "__fish_covis_using_subcommand eval; and __fish_seen_subcommand_from ape" -l format -d 'Format of all files [default: detected from names and first lines]' -r -f -a "tum\t'TUM trajectory'
kitti\t'KITTI odometry poses'
euroc\t'EuRoC (ASL) ground truth'"
complete -c covis -n "__fish_covis_using_subcommand eval; and __fish_seen_subcommand_from ape" -l max-time-difference -d 'Timestamps match within this many seconds' -r
complete -c covis -n "__fish_covis_using_subcommand eval; and __fish_seen_subcommand_from ape" -l n-to-align -d 'Fit the alignment to this many matched poses from the start [default: all]' -r
complete -c covis -n "__fish_covis_using_subcommand eval; and __fish_seen_subcommand_from ape" -l report -d 'Write a report with plots and tables: one HTML file without scripts, for a browser' -r -F
complete -c covis -n "__fish_covis_using_subcommand eval; and __fish_seen_subcommand_from ape" -l align -d 'What is corrected before the comparison' -r -f -a "se3\t'Rotation and translation (evo\'s -a)'
sim3\t'Rotation, translation and scale (-as), for one camera'
scale\t'The scale alone (-s)'
none\t'Nothing: both are in one frame'
origin\t'The first matched pose becomes the true one (--align_origin)'"
complete -c covis -n "__fish_covis_using_subcommand eval; and __fish_seen_subcommand_from ape" -l pose-relation -d 'The error that stands first and that reports draw, by evo\'s names' -r -f -a "trans_part\t'Length of the translation error, m'
rot_part\t'Frobenius norm of R - I of the error'
full\t'Frobenius norm of E - I of the error'
angle_deg\t'Angle of the rotation error, degrees'
angle_rad\t'Angle of the rotation error, radians'
point_distance\t'Difference of the distances moved, m'"
complete -c covis -n "__fish_covis_using_subcommand eval; and __fish_seen_subcommand_from ape" -l config -d 'Configuration file instead of ./covis.toml [env: COVIS_CONFIG]' -r -F
complete -c covis -n "__fish_covis_using_subcommand eval; and __fish_seen_subcommand_from ape" -l log -d 'Log level (off, error, warn, info, debug, trace) or a list of them, `target=level` [default: info; warn of commands that do not write to a terminal] [env: COVIS_LOG]' -r
complete -c covis -n "__fish_covis_using_subcommand eval; and __fish_seen_subcommand_from ape" -l log-format -d 'Format of log lines [default: text] [env: COVIS_LOG_FORMAT]' -r -f -a "text\t'For people'
json\t'One JSON object a line'"
complete -c covis -n "__fish_covis_using_subcommand eval; and __fish_seen_subcommand_from ape" -l json -d 'Print one JSON object instead of a table'
complete -c covis -n "__fish_covis_using_subcommand eval; and __fish_seen_subcommand_from ape" -s h -l help -d 'Print help (see more with \'--help\')'
complete -c covis -n "__fish_covis_using_subcommand eval; and __fish_seen_subcommand_from rpe" -l format -d 'Format of all files [default: detected from names and first lines]' -r -f -a "tum\t'TUM trajectory'
kitti\t'KITTI odometry poses'
euroc\t'EuRoC (ASL) ground truth'"
complete -c covis -n "__fish_covis_using_subcommand eval; and __fish_seen_subcommand_from rpe" -l max-time-difference -d 'Timestamps match within this many seconds' -r
complete -c covis -n "__fish_covis_using_subcommand eval; and __fish_seen_subcommand_from rpe" -l n-to-align -d 'Fit the alignment to this many matched poses from the start [default: all]' -r
complete -c covis -n "__fish_covis_using_subcommand eval; and __fish_seen_subcommand_from rpe" -l report -d 'Write a report with plots and tables: one HTML file without scripts, for a browser' -r -F
complete -c covis -n "__fish_covis_using_subcommand eval; and __fish_seen_subcommand_from rpe" -l align -d 'What is corrected before the comparison. Only the scale changes relative errors' -r -f -a "se3\t'Rotation and translation (evo\'s -a)'
sim3\t'Rotation, translation and scale (-as), for one camera'
scale\t'The scale alone (-s)'
none\t'Nothing: both are in one frame'
origin\t'The first matched pose becomes the true one (--align_origin)'"
complete -c covis -n "__fish_covis_using_subcommand eval; and __fish_seen_subcommand_from rpe" -l pose-relation -d 'The error that stands first and that reports draw, by evo\'s names' -r -f -a "trans_part\t'Length of the translation error, m'
rot_part\t'Frobenius norm of R - I of the error'
full\t'Frobenius norm of E - I of the error'
angle_deg\t'Angle of the rotation error, degrees'
angle_rad\t'Angle of the rotation error, radians'
point_distance\t'Difference of the distances moved, m'
point_distance_error_ratio\t'The same over the true distance, percent'"
complete -c covis -n "__fish_covis_using_subcommand eval; and __fish_seen_subcommand_from rpe" -l delta -d 'How far apart the poses of a pair are, in the unit of --delta-unit' -r
complete -c covis -n "__fish_covis_using_subcommand eval; and __fish_seen_subcommand_from rpe" -l delta-unit -d 'Unit of --delta' -r -f -a "f\t'Matched poses'
m\t'Meters of path'
d\t'Degrees of rotation'
r\t'Radians of rotation'"
complete -c covis -n "__fish_covis_using_subcommand eval; and __fish_seen_subcommand_from rpe" -l delta-tol -d 'With --all-pairs, path or angle may differ from --delta by this share of it' -r
complete -c covis -n "__fish_covis_using_subcommand eval; and __fish_seen_subcommand_from rpe" -l delta-s -d 'Measure over this time' -r
complete -c covis -n "__fish_covis_using_subcommand eval; and __fish_seen_subcommand_from rpe" -l config -d 'Configuration file instead of ./covis.toml [env: COVIS_CONFIG]' -r -F
complete -c covis -n "__fish_covis_using_subcommand eval; and __fish_seen_subcommand_from rpe" -l log -d 'Log level (off, error, warn, info, debug, trace) or a list of them, `target=level` [default: info; warn of commands that do not write to a terminal] [env: COVIS_LOG]' -r
complete -c covis -n "__fish_covis_using_subcommand eval; and __fish_seen_subcommand_from rpe" -l log-format -d 'Format of log lines [default: text] [env: COVIS_LOG_FORMAT]' -r -f -a "text\t'For people'
json\t'One JSON object a line'"
complete -c covis -n "__fish_covis_using_subcommand eval; and __fish_seen_subcommand_from rpe" -l json -d 'Print one JSON object instead of a table'
complete -c covis -n "__fish_covis_using_subcommand eval; and __fish_seen_subcommand_from rpe" -l all-pairs -d 'Begin a pair at each pose; otherwise each begins where the last one ended'
complete -c covis -n "__fish_covis_using_subcommand eval; and __fish_seen_subcommand_from rpe" -l pairs-from-reference -d 'Measure path and angle along the truth, so that all estimates have the same pairs; otherwise along the estimate'
complete -c covis -n "__fish_covis_using_subcommand eval; and __fish_seen_subcommand_from rpe" -l per-second -d 'Measure over one second, as the TUM scripts do: the drift in m/s and deg/s'
complete -c covis -n "__fish_covis_using_subcommand eval; and __fish_seen_subcommand_from rpe" -s h -l help -d 'Print help (see more with \'--help\')'
complete -c covis -n "__fish_covis_using_subcommand eval; and __fish_seen_subcommand_from mask" -l report -d 'Write a report with plots and tables: one HTML file without scripts, for a browser' -r -F
complete -c covis -n "__fish_covis_using_subcommand eval; and __fish_seen_subcommand_from mask" -l config -d 'Configuration file instead of ./covis.toml [env: COVIS_CONFIG]' -r -F
complete -c covis -n "__fish_covis_using_subcommand eval; and __fish_seen_subcommand_from mask" -l log -d 'Log level (off, error, warn, info, debug, trace) or a list of them, `target=level` [default: info; warn of commands that do not write to a terminal] [env: COVIS_LOG]' -r
complete -c covis -n "__fish_covis_using_subcommand eval; and __fish_seen_subcommand_from mask" -l log-format -d 'Format of log lines [default: text] [env: COVIS_LOG_FORMAT]' -r -f -a "text\t'For people'
json\t'One JSON object a line'"
complete -c covis -n "__fish_covis_using_subcommand eval; and __fish_seen_subcommand_from mask" -l static -d 'Nothing moves in the sequence: every masked pixel is false'
complete -c covis -n "__fish_covis_using_subcommand eval; and __fish_seen_subcommand_from mask" -l json -d 'Print one JSON object instead of a table'
complete -c covis -n "__fish_covis_using_subcommand eval; and __fish_seen_subcommand_from mask" -s h -l help -d 'Print help (see more with \'--help\')'
complete -c covis -n "__fish_covis_using_subcommand eval; and __fish_seen_subcommand_from truth" -l format -d 'Format of the trajectory' -r -f -a "tum\t'TUM trajectory'
kitti\t'KITTI odometry poses'
euroc\t'EuRoC (ASL) ground truth'"
complete -c covis -n "__fish_covis_using_subcommand eval; and __fish_seen_subcommand_from truth" -l config -d 'Configuration file instead of ./covis.toml [env: COVIS_CONFIG]' -r -F
complete -c covis -n "__fish_covis_using_subcommand eval; and __fish_seen_subcommand_from truth" -l log -d 'Log level (off, error, warn, info, debug, trace) or a list of them, `target=level` [default: info; warn of commands that do not write to a terminal] [env: COVIS_LOG]' -r
complete -c covis -n "__fish_covis_using_subcommand eval; and __fish_seen_subcommand_from truth" -l log-format -d 'Format of log lines [default: text] [env: COVIS_LOG_FORMAT]' -r -f -a "text\t'For people'
json\t'One JSON object a line'"
complete -c covis -n "__fish_covis_using_subcommand eval; and __fish_seen_subcommand_from truth" -l force -d 'Replace files that are there'
complete -c covis -n "__fish_covis_using_subcommand eval; and __fish_seen_subcommand_from truth" -l json -d 'Print one JSON object instead of a sentence'
complete -c covis -n "__fish_covis_using_subcommand eval; and __fish_seen_subcommand_from truth" -s h -l help -d 'Print help (see more with \'--help\')'
complete -c covis -n "__fish_covis_using_subcommand eval; and __fish_seen_subcommand_from help" -f -a "ape" -d 'Absolute pose error of aligned trajectories'
complete -c covis -n "__fish_covis_using_subcommand eval; and __fish_seen_subcommand_from help" -f -a "rpe" -d 'Relative pose error from one matched pose to the next, or over a number of poses, a path, an angle or a time'
complete -c covis -n "__fish_covis_using_subcommand eval; and __fish_seen_subcommand_from help" -f -a "mask" -d 'Intersection over union of masks of moving objects, and the share that they mask falsely'
complete -c covis -n "__fish_covis_using_subcommand eval; and __fish_seen_subcommand_from help" -f -a "truth" -d 'Write the ground-truth poses beside recorded images as a trajectory'
complete -c covis -n "__fish_covis_using_subcommand eval; and __fish_seen_subcommand_from help" -f -a "help" -d 'Print this message or the help of the given subcommand(s)'
complete -c covis -n "__fish_covis_using_subcommand fuse" -l poses -d 'Poses of the camera: a TUM or EuRoC trajectory, or a recorded folder or a capture with poses beside its images. Poses are interpolated; frames without a pose within 0.02 s are skipped' -r -F
complete -c covis -n "__fish_covis_using_subcommand fuse" -l out -d 'Folder for mesh.ply and volume.covis; it is created if it is missing' -r -F
complete -c covis -n "__fish_covis_using_subcommand fuse" -l voxel -d 'Edge length of a voxel, meters' -r
complete -c covis -n "__fish_covis_using_subcommand fuse" -l truncation-voxels -d 'Truncation distance, voxels' -r
complete -c covis -n "__fish_covis_using_subcommand fuse" -l memory-mb -d 'Maximum size of the volume in memory, megabytes; parts far from the camera move to a temporary file in OUT [default: no limit]' -r
complete -c covis -n "__fish_covis_using_subcommand fuse" -l remesh -d 'Update the surface after each frame, at most this many changed blocks, oldest first; the rest waits for later frames [default: compute the surface at the end]' -r
complete -c covis -n "__fish_covis_using_subcommand fuse" -l max-depth -d 'Maximum depth that is used, meters' -r
complete -c covis -n "__fish_covis_using_subcommand fuse" -l camera -d 'Intrinsics, px: a file, or fx,fy,cx,cy[,k1,k2,p1,p2,k3]' -r
complete -c covis -n "__fish_covis_using_subcommand fuse" -l depth-scale -d 'Units of the depth images per meter: 1000 for millimeters [default: 5000 for the TUM layout, 1000 for 7-Scenes, for captures and for 16-bit depth of ROS, 1 for its 32-bit depth]' -r
complete -c covis -n "__fish_covis_using_subcommand fuse" -l color-topic -d 'Topic of the color images of an MCAP file or a bag [default: found by type and name]' -r
complete -c covis -n "__fish_covis_using_subcommand fuse" -l depth-topic -d 'Topic of the depth images, registered to color [default: found by type and name]' -r
complete -c covis -n "__fish_covis_using_subcommand fuse" -l camera-info-topic -d 'Topic of the camera\'s intrinsics [default: camera_info beside the color images]' -r
complete -c covis -n "__fish_covis_using_subcommand fuse" -l threads -d 'Threads [default: all processors]' -r
complete -c covis -n "__fish_covis_using_subcommand fuse" -l seed -d 'Seed of a synthetic scene' -r
complete -c covis -n "__fish_covis_using_subcommand fuse" -l frames -d 'Frames of a synthetic scene' -r
complete -c covis -n "__fish_covis_using_subcommand fuse" -l config -d 'Configuration file instead of ./covis.toml [env: COVIS_CONFIG]' -r -F
complete -c covis -n "__fish_covis_using_subcommand fuse" -l log -d 'Log level (off, error, warn, info, debug, trace) or a list of them, `target=level` [default: info; warn of commands that do not write to a terminal] [env: COVIS_LOG]' -r
complete -c covis -n "__fish_covis_using_subcommand fuse" -l log-format -d 'Format of log lines [default: text] [env: COVIS_LOG_FORMAT]' -r -f -a "text\t'For people'
json\t'One JSON object a line'"
complete -c covis -n "__fish_covis_using_subcommand fuse" -l force -d 'Replace files that are there'
complete -c covis -n "__fish_covis_using_subcommand fuse" -l json -d 'Print one JSON object instead of a table'
complete -c covis -n "__fish_covis_using_subcommand fuse" -s h -l help -d 'Print help (see more with \'--help\')'
complete -c covis -n "__fish_covis_using_subcommand mesh" -l memory-mb -d 'Maximum size of the volume in memory, megabytes; the rest moves to a temporary file beside OUT [default: no limit; 4.2 KB per block]' -r
complete -c covis -n "__fish_covis_using_subcommand mesh" -l config -d 'Configuration file instead of ./covis.toml [env: COVIS_CONFIG]' -r -F
complete -c covis -n "__fish_covis_using_subcommand mesh" -l log -d 'Log level (off, error, warn, info, debug, trace) or a list of them, `target=level` [default: info; warn of commands that do not write to a terminal] [env: COVIS_LOG]' -r
complete -c covis -n "__fish_covis_using_subcommand mesh" -l log-format -d 'Format of log lines [default: text] [env: COVIS_LOG_FORMAT]' -r -f -a "text\t'For people'
json\t'One JSON object a line'"
complete -c covis -n "__fish_covis_using_subcommand mesh" -l force -d 'Replace files that are there'
complete -c covis -n "__fish_covis_using_subcommand mesh" -s h -l help -d 'Print help (see more with \'--help\')'
complete -c covis -n "__fish_covis_using_subcommand grid" -l up -d 'Up direction in the volume\'s frame [default: 0,-1,0, for a first camera that was held level]' -r
complete -c covis -n "__fish_covis_using_subcommand grid" -l heights -d 'Heights between which a surface is an obstacle, meters along up from the volume\'s origin [default: -1.4,0.4]' -r
complete -c covis -n "__fish_covis_using_subcommand grid" -l slice -d 'Height of the slice of distances, meters along up' -r
complete -c covis -n "__fish_covis_using_subcommand grid" -l memory-mb -d 'Maximum size of the volume in memory, megabytes; the rest moves to a temporary file beside OUT [default: no limit; 4.2 KB per block]' -r
complete -c covis -n "__fish_covis_using_subcommand grid" -l config -d 'Configuration file instead of ./covis.toml [env: COVIS_CONFIG]' -r -F
complete -c covis -n "__fish_covis_using_subcommand grid" -l log -d 'Log level (off, error, warn, info, debug, trace) or a list of them, `target=level` [default: info; warn of commands that do not write to a terminal] [env: COVIS_LOG]' -r
complete -c covis -n "__fish_covis_using_subcommand grid" -l log-format -d 'Format of log lines [default: text] [env: COVIS_LOG_FORMAT]' -r -f -a "text\t'For people'
json\t'One JSON object a line'"
complete -c covis -n "__fish_covis_using_subcommand grid" -l force -d 'Replace files that are there'
complete -c covis -n "__fish_covis_using_subcommand grid" -s h -l help -d 'Print help (see more with \'--help\')'
complete -c covis -n "__fish_covis_using_subcommand bench-frontend" -l out -d 'Folder for trajectories and masks; each run gets its own subfolder' -r -F
complete -c covis -n "__fish_covis_using_subcommand bench-frontend" -l threads -d 'Threads; a single one decodes and tracks frames in turn' -r
complete -c covis -n "__fish_covis_using_subcommand bench-frontend" -l seed -d 'Seed of a synthetic scene' -r
complete -c covis -n "__fish_covis_using_subcommand bench-frontend" -l frames -d 'Frames of a synthetic scene' -r
complete -c covis -n "__fish_covis_using_subcommand bench-frontend" -l report -d 'Write a report with plots and tables: one HTML file without scripts, for a browser' -r -F
complete -c covis -n "__fish_covis_using_subcommand bench-frontend" -l config -d 'Configuration file instead of ./covis.toml [env: COVIS_CONFIG]' -r -F
complete -c covis -n "__fish_covis_using_subcommand bench-frontend" -l log -d 'Log level (off, error, warn, info, debug, trace) or a list of them, `target=level` [default: info; warn of commands that do not write to a terminal] [env: COVIS_LOG]' -r
complete -c covis -n "__fish_covis_using_subcommand bench-frontend" -l log-format -d 'Format of log lines [default: text] [env: COVIS_LOG_FORMAT]' -r -f -a "text\t'For people'
json\t'One JSON object a line'"
complete -c covis -n "__fish_covis_using_subcommand bench-frontend" -l json -d 'Print one JSON object instead of tables'
complete -c covis -n "__fish_covis_using_subcommand bench-frontend" -s h -l help -d 'Print help (see more with \'--help\')'
complete -c covis -n "__fish_covis_using_subcommand demo" -l out -d 'Folder for the map and the trajectories; it is created if it is missing' -r -F
complete -c covis -n "__fish_covis_using_subcommand demo" -l frames -d 'Frames, 30 a second; a round takes 180' -r
complete -c covis -n "__fish_covis_using_subcommand demo" -l seed -d 'Seed of the scene and of all noise' -r
complete -c covis -n "__fish_covis_using_subcommand demo" -l config -d 'Configuration file instead of ./covis.toml [env: COVIS_CONFIG]' -r -F
complete -c covis -n "__fish_covis_using_subcommand demo" -l log -d 'Log level (off, error, warn, info, debug, trace) or a list of them, `target=level` [default: info; warn of commands that do not write to a terminal] [env: COVIS_LOG]' -r
complete -c covis -n "__fish_covis_using_subcommand demo" -l log-format -d 'Format of log lines [default: text] [env: COVIS_LOG_FORMAT]' -r -f -a "text\t'For people'
json\t'One JSON object a line'"
complete -c covis -n "__fish_covis_using_subcommand demo" -l force -d 'Replace files that are there'
complete -c covis -n "__fish_covis_using_subcommand demo" -l keep -d 'Keep the server and its page until ctrl-c'
complete -c covis -n "__fish_covis_using_subcommand demo" -s h -l help -d 'Print help (see more with \'--help\')'
complete -c covis -n "__fish_covis_using_subcommand synth; and not __fish_seen_subcommand_from rgbd help" -l config -d 'Configuration file instead of ./covis.toml [env: COVIS_CONFIG]' -r -F
complete -c covis -n "__fish_covis_using_subcommand synth; and not __fish_seen_subcommand_from rgbd help" -l log -d 'Log level (off, error, warn, info, debug, trace) or a list of them, `target=level` [default: info; warn of commands that do not write to a terminal] [env: COVIS_LOG]' -r
complete -c covis -n "__fish_covis_using_subcommand synth; and not __fish_seen_subcommand_from rgbd help" -l log-format -d 'Format of log lines [default: text] [env: COVIS_LOG_FORMAT]' -r -f -a "text\t'For people'
json\t'One JSON object a line'"
complete -c covis -n "__fish_covis_using_subcommand synth; and not __fish_seen_subcommand_from rgbd help" -s h -l help -d 'Print help (see more with \'--help\')'
complete -c covis -n "__fish_covis_using_subcommand synth; and not __fish_seen_subcommand_from rgbd help" -f -a "rgbd" -d 'An RGB-D sequence of an indoor scene: color, depth, ground truth of the camera, masks of moving objects'
complete -c covis -n "__fish_covis_using_subcommand synth; and not __fish_seen_subcommand_from rgbd help" -f -a "help" -d 'Print this message or the help of the given subcommand(s)'
complete -c covis -n "__fish_covis_using_subcommand synth; and __fish_seen_subcommand_from rgbd" -l scene -d 'static, walking, sitting, pushed, exposure, loop, covered or rounds' -r
complete -c covis -n "__fish_covis_using_subcommand synth; and __fish_seen_subcommand_from rgbd" -l seed -d 'Seed; the same scene and seed give the same bytes' -r
complete -c covis -n "__fish_covis_using_subcommand synth; and __fish_seen_subcommand_from rgbd" -l frames -d 'How many frames of 640 x 480 pixels, 30 a second' -r
complete -c covis -n "__fish_covis_using_subcommand synth; and __fish_seen_subcommand_from rgbd" -l config -d 'Configuration file instead of ./covis.toml [env: COVIS_CONFIG]' -r -F
complete -c covis -n "__fish_covis_using_subcommand synth; and __fish_seen_subcommand_from rgbd" -l log -d 'Log level (off, error, warn, info, debug, trace) or a list of them, `target=level` [default: info; warn of commands that do not write to a terminal] [env: COVIS_LOG]' -r
complete -c covis -n "__fish_covis_using_subcommand synth; and __fish_seen_subcommand_from rgbd" -l log-format -d 'Format of log lines [default: text] [env: COVIS_LOG_FORMAT]' -r -f -a "text\t'For people'
json\t'One JSON object a line'"
complete -c covis -n "__fish_covis_using_subcommand synth; and __fish_seen_subcommand_from rgbd" -l force -d 'Replace files that are there'
complete -c covis -n "__fish_covis_using_subcommand synth; and __fish_seen_subcommand_from rgbd" -l no-noise -d 'Exact depth and color, without a Kinect\'s noise and gaps'
complete -c covis -n "__fish_covis_using_subcommand synth; and __fish_seen_subcommand_from rgbd" -s h -l help -d 'Print help (see more with \'--help\')'
complete -c covis -n "__fish_covis_using_subcommand synth; and __fish_seen_subcommand_from help" -f -a "rgbd" -d 'An RGB-D sequence of an indoor scene: color, depth, ground truth of the camera, masks of moving objects'
complete -c covis -n "__fish_covis_using_subcommand synth; and __fish_seen_subcommand_from help" -f -a "help" -d 'Print this message or the help of the given subcommand(s)'
complete -c covis -n "__fish_covis_using_subcommand completions" -l config -d 'Configuration file instead of ./covis.toml [env: COVIS_CONFIG]' -r -F
complete -c covis -n "__fish_covis_using_subcommand completions" -l log -d 'Log level (off, error, warn, info, debug, trace) or a list of them, `target=level` [default: info; warn of commands that do not write to a terminal] [env: COVIS_LOG]' -r
complete -c covis -n "__fish_covis_using_subcommand completions" -l log-format -d 'Format of log lines [default: text] [env: COVIS_LOG_FORMAT]' -r -f -a "text\t'For people'
json\t'One JSON object a line'"
complete -c covis -n "__fish_covis_using_subcommand completions" -s h -l help -d 'Print help (see more with \'--help\')'
complete -c covis -n "__fish_covis_using_subcommand health" -l server -d 'The server\'s URL [default: http://127.0.0.1:7411] [env: COVIS_SERVER]' -r
complete -c covis -n "__fish_covis_using_subcommand health" -l ca -d 'Certificates (PEM) of the authorities to trust instead of the system\'s [env: COVIS_CA]' -r -F
complete -c covis -n "__fish_covis_using_subcommand health" -l cert -d 'The client\'s own certificate (PEM), for mutual TLS [env: COVIS_CERT]' -r -F
complete -c covis -n "__fish_covis_using_subcommand health" -l key -d 'The private key of --cert (PEM) [env: COVIS_KEY]' -r -F
complete -c covis -n "__fish_covis_using_subcommand health" -l token-file -d 'File that holds the bearer token; COVIS_TOKEN holds the token itself [env: COVIS_TOKEN_FILE]' -r -F
complete -c covis -n "__fish_covis_using_subcommand health" -l config -d 'Configuration file instead of ./covis.toml [env: COVIS_CONFIG]' -r -F
complete -c covis -n "__fish_covis_using_subcommand health" -l log -d 'Log level (off, error, warn, info, debug, trace) or a list of them, `target=level` [default: info; warn of commands that do not write to a terminal] [env: COVIS_LOG]' -r
complete -c covis -n "__fish_covis_using_subcommand health" -l log-format -d 'Format of log lines [default: text] [env: COVIS_LOG_FORMAT]' -r -f -a "text\t'For people'
json\t'One JSON object a line'"
complete -c covis -n "__fish_covis_using_subcommand health" -l json -d 'Print one JSON object instead of a sentence'
complete -c covis -n "__fish_covis_using_subcommand health" -s h -l help -d 'Print help (see more with \'--help\')'
complete -c covis -n "__fish_covis_using_subcommand job; and not __fish_seen_subcommand_from submit list ls show watch cancel delete rm fetch help" -l server -d 'The server\'s URL [default: http://127.0.0.1:7411] [env: COVIS_SERVER]' -r
complete -c covis -n "__fish_covis_using_subcommand job; and not __fish_seen_subcommand_from submit list ls show watch cancel delete rm fetch help" -l ca -d 'Certificates (PEM) of the authorities to trust instead of the system\'s [env: COVIS_CA]' -r -F
complete -c covis -n "__fish_covis_using_subcommand job; and not __fish_seen_subcommand_from submit list ls show watch cancel delete rm fetch help" -l cert -d 'The client\'s own certificate (PEM), for mutual TLS [env: COVIS_CERT]' -r -F
complete -c covis -n "__fish_covis_using_subcommand job; and not __fish_seen_subcommand_from submit list ls show watch cancel delete rm fetch help" -l key -d 'The private key of --cert (PEM) [env: COVIS_KEY]' -r -F
complete -c covis -n "__fish_covis_using_subcommand job; and not __fish_seen_subcommand_from submit list ls show watch cancel delete rm fetch help" -l token-file -d 'File that holds the bearer token; COVIS_TOKEN holds the token itself [env: COVIS_TOKEN_FILE]' -r -F
complete -c covis -n "__fish_covis_using_subcommand job; and not __fish_seen_subcommand_from submit list ls show watch cancel delete rm fetch help" -l server-wait -d 'Seconds to wait for a server that does not answer yet or still opens its maps; 0 fails at once [default: 10] [env: COVIS_SERVER_WAIT]' -r
complete -c covis -n "__fish_covis_using_subcommand job; and not __fish_seen_subcommand_from submit list ls show watch cancel delete rm fetch help" -l config -d 'Configuration file instead of ./covis.toml [env: COVIS_CONFIG]' -r -F
complete -c covis -n "__fish_covis_using_subcommand job; and not __fish_seen_subcommand_from submit list ls show watch cancel delete rm fetch help" -l log -d 'Log level (off, error, warn, info, debug, trace) or a list of them, `target=level` [default: info; warn of commands that do not write to a terminal] [env: COVIS_LOG]' -r
complete -c covis -n "__fish_covis_using_subcommand job; and not __fish_seen_subcommand_from submit list ls show watch cancel delete rm fetch help" -l log-format -d 'Format of log lines [default: text] [env: COVIS_LOG_FORMAT]' -r -f -a "text\t'For people'
json\t'One JSON object a line'"
complete -c covis -n "__fish_covis_using_subcommand job; and not __fish_seen_subcommand_from submit list ls show watch cancel delete rm fetch help" -l json -d 'Print JSON instead of text'
complete -c covis -n "__fish_covis_using_subcommand job; and not __fish_seen_subcommand_from submit list ls show watch cancel delete rm fetch help" -s h -l help -d 'Print help (see more with \'--help\')'
complete -c covis -n "__fish_covis_using_subcommand job; and not __fish_seen_subcommand_from submit list ls show watch cancel delete rm fetch help" -f -a "submit" -d 'Create a job on a map of the server, or on files that are sent to it'
complete -c covis -n "__fish_covis_using_subcommand job; and not __fish_seen_subcommand_from submit list ls show watch cancel delete rm fetch help" -f -a "list" -d 'List the jobs, the newest first'
complete -c covis -n "__fish_covis_using_subcommand job; and not __fish_seen_subcommand_from submit list ls show watch cancel delete rm fetch help" -f -a "ls" -d 'List the jobs, the newest first'
complete -c covis -n "__fish_covis_using_subcommand job; and not __fish_seen_subcommand_from submit list ls show watch cancel delete rm fetch help" -f -a "show" -d 'Show a job with its report'
complete -c covis -n "__fish_covis_using_subcommand job; and not __fish_seen_subcommand_from submit list ls show watch cancel delete rm fetch help" -f -a "watch" -d 'Follow a job to its end and print a line at each change'
complete -c covis -n "__fish_covis_using_subcommand job; and not __fish_seen_subcommand_from submit list ls show watch cancel delete rm fetch help" -f -a "cancel" -d 'Ask a job to stop without applying its result'
complete -c covis -n "__fish_covis_using_subcommand job; and not __fish_seen_subcommand_from submit list ls show watch cancel delete rm fetch help" -f -a "delete" -d 'Delete a job that has ended, with its files'
complete -c covis -n "__fish_covis_using_subcommand job; and not __fish_seen_subcommand_from submit list ls show watch cancel delete rm fetch help" -f -a "rm" -d 'Delete a job that has ended, with its files'
complete -c covis -n "__fish_covis_using_subcommand job; and not __fish_seen_subcommand_from submit list ls show watch cancel delete rm fetch help" -f -a "fetch" -d 'Write the files that a job made: the report, solved problems, an export'
complete -c covis -n "__fish_covis_using_subcommand job; and not __fish_seen_subcommand_from submit list ls show watch cancel delete rm fetch help" -f -a "help" -d 'Print this message or the help of the given subcommand(s)'
complete -c covis -n "__fish_covis_using_subcommand job; and __fish_seen_subcommand_from submit" -l map -d 'The map that the job works on' -r
complete -c covis -n "__fish_covis_using_subcommand job; and __fish_seen_subcommand_from submit" -l file -d 'A problem to solve instead of a map: a BAL or g2o file, a folder with a COLMAP sparse model, or a folder of such problems. It is sent to the server' -r -F
complete -c covis -n "__fish_covis_using_subcommand job; and __fish_seen_subcommand_from submit" -l id -d 'The job\'s name. If you repeat the command with the same name and arguments, and without files, it returns the existing job [default: a new name]' -r
complete -c covis -n "__fish_covis_using_subcommand job; and __fish_seen_subcommand_from submit" -l priority -d 'Waiting jobs with a higher priority start first, -100 to 100' -r
complete -c covis -n "__fish_covis_using_subcommand job; and __fish_seen_subcommand_from submit" -l out -d 'Wait, and write the files that the job makes: solved problems, an export. One file goes to this path, several into this folder' -r -F
complete -c covis -n "__fish_covis_using_subcommand job; and __fish_seen_subcommand_from submit" -l max-iterations -d 'optimize-map, optimize-pose-graph on a map: maximum number of iterations [default: until it converges]' -r
complete -c covis -n "__fish_covis_using_subcommand job; and __fish_seen_subcommand_from submit" -l time-limit -d 'optimize-map, optimize-pose-graph on a map: stop after this time with the best state so far [default: when it converges]' -r
complete -c covis -n "__fish_covis_using_subcommand job; and __fish_seen_subcommand_from submit" -l redundant-share -d 'compact: retire a keyframe if three others see this share of its landmarks' -r
complete -c covis -n "__fish_covis_using_subcommand job; and __fish_seen_subcommand_from submit" -l truth -d 'evaluate: the ground truth as a TUM trajectory' -r -F
complete -c covis -n "__fish_covis_using_subcommand job; and __fish_seen_subcommand_from submit" -l client -d 'evaluate: the client whose keyframes are compared [default: the map\'s only one]' -r
complete -c covis -n "__fish_covis_using_subcommand job; and __fish_seen_subcommand_from submit" -l max-time-difference -d 'evaluate: timestamps match within this many seconds [default: 0.01]' -r
complete -c covis -n "__fish_covis_using_subcommand job; and __fish_seen_subcommand_from submit" -l format -d 'export: what to write' -r -f -a "colmap-text\t'COLMAP sparse model as text'
colmap-binary\t'COLMAP sparse model in binary'
tum\t'TUM trajectories'
kitti\t'KITTI\'s poses, without times'
euroc\t'Trajectories as EuRoC\'s ground truth; the body is the camera'
g2o\t'Pose graph as the server solves it: relative poses that keyframes measure, and constraints that are not switched off. `covis solve pose-graph` finds the same poses'
ply\t'Landmarks and trajectories for viewers; cannot be imported'
covis\t'All of the map, to move it to another server'"
complete -c covis -n "__fish_covis_using_subcommand job; and __fish_seen_subcommand_from submit" -l server -d 'The server\'s URL [default: http://127.0.0.1:7411] [env: COVIS_SERVER]' -r
complete -c covis -n "__fish_covis_using_subcommand job; and __fish_seen_subcommand_from submit" -l ca -d 'Certificates (PEM) of the authorities to trust instead of the system\'s [env: COVIS_CA]' -r -F
complete -c covis -n "__fish_covis_using_subcommand job; and __fish_seen_subcommand_from submit" -l cert -d 'The client\'s own certificate (PEM), for mutual TLS [env: COVIS_CERT]' -r -F
complete -c covis -n "__fish_covis_using_subcommand job; and __fish_seen_subcommand_from submit" -l key -d 'The private key of --cert (PEM) [env: COVIS_KEY]' -r -F
complete -c covis -n "__fish_covis_using_subcommand job; and __fish_seen_subcommand_from submit" -l token-file -d 'File that holds the bearer token; COVIS_TOKEN holds the token itself [env: COVIS_TOKEN_FILE]' -r -F
complete -c covis -n "__fish_covis_using_subcommand job; and __fish_seen_subcommand_from submit" -l server-wait -d 'Seconds to wait for a server that does not answer yet or still opens its maps; 0 fails at once [default: 10] [env: COVIS_SERVER_WAIT]' -r
complete -c covis -n "__fish_covis_using_subcommand job; and __fish_seen_subcommand_from submit" -l config -d 'Configuration file instead of ./covis.toml [env: COVIS_CONFIG]' -r -F
complete -c covis -n "__fish_covis_using_subcommand job; and __fish_seen_subcommand_from submit" -l log -d 'Log level (off, error, warn, info, debug, trace) or a list of them, `target=level` [default: info; warn of commands that do not write to a terminal] [env: COVIS_LOG]' -r
complete -c covis -n "__fish_covis_using_subcommand job; and __fish_seen_subcommand_from submit" -l log-format -d 'Format of log lines [default: text] [env: COVIS_LOG_FORMAT]' -r -f -a "text\t'For people'
json\t'One JSON object a line'"
complete -c covis -n "__fish_covis_using_subcommand job; and __fish_seen_subcommand_from submit" -l wait -d 'Wait for the job\'s end; the exit code is 1 if it does not succeed'
complete -c covis -n "__fish_covis_using_subcommand job; and __fish_seen_subcommand_from submit" -l force -d 'Replace files that are there'
complete -c covis -n "__fish_covis_using_subcommand job; and __fish_seen_subcommand_from submit" -l refine-intrinsics -d 'optimize-map on a map: optimize the cameras\' intrinsics too; with files this is always on'
complete -c covis -n "__fish_covis_using_subcommand job; and __fish_seen_subcommand_from submit" -l keep-journal -d 'compact: keep the journal before the snapshot'
complete -c covis -n "__fish_covis_using_subcommand job; and __fish_seen_subcommand_from submit" -l all-points -d 'export to COLMAP: also the points that fewer than two keyframes observe'
complete -c covis -n "__fish_covis_using_subcommand job; and __fish_seen_subcommand_from submit" -l json -d 'Print JSON instead of text'
complete -c covis -n "__fish_covis_using_subcommand job; and __fish_seen_subcommand_from submit" -s h -l help -d 'Print help (see more with \'--help\')'
complete -c covis -n "__fish_covis_using_subcommand job; and __fish_seen_subcommand_from list" -l map -d 'Only jobs on this map' -r
complete -c covis -n "__fish_covis_using_subcommand job; and __fish_seen_subcommand_from list" -l state -d 'Only jobs in this state; may be repeated' -r -f -a "pending\t''
running\t''
succeeded\t''
failed\t''
cancelled\t''"
complete -c covis -n "__fish_covis_using_subcommand job; and __fish_seen_subcommand_from list" -l server -d 'The server\'s URL [default: http://127.0.0.1:7411] [env: COVIS_SERVER]' -r
complete -c covis -n "__fish_covis_using_subcommand job; and __fish_seen_subcommand_from list" -l ca -d 'Certificates (PEM) of the authorities to trust instead of the system\'s [env: COVIS_CA]' -r -F
complete -c covis -n "__fish_covis_using_subcommand job; and __fish_seen_subcommand_from list" -l cert -d 'The client\'s own certificate (PEM), for mutual TLS [env: COVIS_CERT]' -r -F
complete -c covis -n "__fish_covis_using_subcommand job; and __fish_seen_subcommand_from list" -l key -d 'The private key of --cert (PEM) [env: COVIS_KEY]' -r -F
complete -c covis -n "__fish_covis_using_subcommand job; and __fish_seen_subcommand_from list" -l token-file -d 'File that holds the bearer token; COVIS_TOKEN holds the token itself [env: COVIS_TOKEN_FILE]' -r -F
complete -c covis -n "__fish_covis_using_subcommand job; and __fish_seen_subcommand_from list" -l server-wait -d 'Seconds to wait for a server that does not answer yet or still opens its maps; 0 fails at once [default: 10] [env: COVIS_SERVER_WAIT]' -r
complete -c covis -n "__fish_covis_using_subcommand job; and __fish_seen_subcommand_from list" -l config -d 'Configuration file instead of ./covis.toml [env: COVIS_CONFIG]' -r -F
complete -c covis -n "__fish_covis_using_subcommand job; and __fish_seen_subcommand_from list" -l log -d 'Log level (off, error, warn, info, debug, trace) or a list of them, `target=level` [default: info; warn of commands that do not write to a terminal] [env: COVIS_LOG]' -r
complete -c covis -n "__fish_covis_using_subcommand job; and __fish_seen_subcommand_from list" -l log-format -d 'Format of log lines [default: text] [env: COVIS_LOG_FORMAT]' -r -f -a "text\t'For people'
json\t'One JSON object a line'"
complete -c covis -n "__fish_covis_using_subcommand job; and __fish_seen_subcommand_from list" -l json -d 'Print JSON instead of text'
complete -c covis -n "__fish_covis_using_subcommand job; and __fish_seen_subcommand_from list" -s h -l help -d 'Print help (see more with \'--help\')'
complete -c covis -n "__fish_covis_using_subcommand job; and __fish_seen_subcommand_from ls" -l map -d 'Only jobs on this map' -r
complete -c covis -n "__fish_covis_using_subcommand job; and __fish_seen_subcommand_from ls" -l state -d 'Only jobs in this state; may be repeated' -r -f -a "pending\t''
running\t''
succeeded\t''
failed\t''
cancelled\t''"
complete -c covis -n "__fish_covis_using_subcommand job; and __fish_seen_subcommand_from ls" -l server -d 'The server\'s URL [default: http://127.0.0.1:7411] [env: COVIS_SERVER]' -r
complete -c covis -n "__fish_covis_using_subcommand job; and __fish_seen_subcommand_from ls" -l ca -d 'Certificates (PEM) of the authorities to trust instead of the system\'s [env: COVIS_CA]' -r -F
complete -c covis -n "__fish_covis_using_subcommand job; and __fish_seen_subcommand_from ls" -l cert -d 'The client\'s own certificate (PEM), for mutual TLS [env: COVIS_CERT]' -r -F
complete -c covis -n "__fish_covis_using_subcommand job; and __fish_seen_subcommand_from ls" -l key -d 'The private key of --cert (PEM) [env: COVIS_KEY]' -r -F
complete -c covis -n "__fish_covis_using_subcommand job; and __fish_seen_subcommand_from ls" -l token-file -d 'File that holds the bearer token; COVIS_TOKEN holds the token itself [env: COVIS_TOKEN_FILE]' -r -F
complete -c covis -n "__fish_covis_using_subcommand job; and __fish_seen_subcommand_from ls" -l server-wait -d 'Seconds to wait for a server that does not answer yet or still opens its maps; 0 fails at once [default: 10] [env: COVIS_SERVER_WAIT]' -r
complete -c covis -n "__fish_covis_using_subcommand job; and __fish_seen_subcommand_from ls" -l config -d 'Configuration file instead of ./covis.toml [env: COVIS_CONFIG]' -r -F
complete -c covis -n "__fish_covis_using_subcommand job; and __fish_seen_subcommand_from ls" -l log -d 'Log level (off, error, warn, info, debug, trace) or a list of them, `target=level` [default: info; warn of commands that do not write to a terminal] [env: COVIS_LOG]' -r
complete -c covis -n "__fish_covis_using_subcommand job; and __fish_seen_subcommand_from ls" -l log-format -d 'Format of log lines [default: text] [env: COVIS_LOG_FORMAT]' -r -f -a "text\t'For people'
json\t'One JSON object a line'"
complete -c covis -n "__fish_covis_using_subcommand job; and __fish_seen_subcommand_from ls" -l json -d 'Print JSON instead of text'
complete -c covis -n "__fish_covis_using_subcommand job; and __fish_seen_subcommand_from ls" -s h -l help -d 'Print help (see more with \'--help\')'
complete -c covis -n "__fish_covis_using_subcommand job; and __fish_seen_subcommand_from show" -l report -d 'Write a report with plots and tables: one HTML file without scripts, for a browser' -r -F
complete -c covis -n "__fish_covis_using_subcommand job; and __fish_seen_subcommand_from show" -l server -d 'The server\'s URL [default: http://127.0.0.1:7411] [env: COVIS_SERVER]' -r
complete -c covis -n "__fish_covis_using_subcommand job; and __fish_seen_subcommand_from show" -l ca -d 'Certificates (PEM) of the authorities to trust instead of the system\'s [env: COVIS_CA]' -r -F
complete -c covis -n "__fish_covis_using_subcommand job; and __fish_seen_subcommand_from show" -l cert -d 'The client\'s own certificate (PEM), for mutual TLS [env: COVIS_CERT]' -r -F
complete -c covis -n "__fish_covis_using_subcommand job; and __fish_seen_subcommand_from show" -l key -d 'The private key of --cert (PEM) [env: COVIS_KEY]' -r -F
complete -c covis -n "__fish_covis_using_subcommand job; and __fish_seen_subcommand_from show" -l token-file -d 'File that holds the bearer token; COVIS_TOKEN holds the token itself [env: COVIS_TOKEN_FILE]' -r -F
complete -c covis -n "__fish_covis_using_subcommand job; and __fish_seen_subcommand_from show" -l server-wait -d 'Seconds to wait for a server that does not answer yet or still opens its maps; 0 fails at once [default: 10] [env: COVIS_SERVER_WAIT]' -r
complete -c covis -n "__fish_covis_using_subcommand job; and __fish_seen_subcommand_from show" -l config -d 'Configuration file instead of ./covis.toml [env: COVIS_CONFIG]' -r -F
complete -c covis -n "__fish_covis_using_subcommand job; and __fish_seen_subcommand_from show" -l log -d 'Log level (off, error, warn, info, debug, trace) or a list of them, `target=level` [default: info; warn of commands that do not write to a terminal] [env: COVIS_LOG]' -r
complete -c covis -n "__fish_covis_using_subcommand job; and __fish_seen_subcommand_from show" -l log-format -d 'Format of log lines [default: text] [env: COVIS_LOG_FORMAT]' -r -f -a "text\t'For people'
json\t'One JSON object a line'"
complete -c covis -n "__fish_covis_using_subcommand job; and __fish_seen_subcommand_from show" -l json -d 'Print JSON instead of text'
complete -c covis -n "__fish_covis_using_subcommand job; and __fish_seen_subcommand_from show" -s h -l help -d 'Print help (see more with \'--help\')'
complete -c covis -n "__fish_covis_using_subcommand job; and __fish_seen_subcommand_from watch" -l server -d 'The server\'s URL [default: http://127.0.0.1:7411] [env: COVIS_SERVER]' -r
complete -c covis -n "__fish_covis_using_subcommand job; and __fish_seen_subcommand_from watch" -l ca -d 'Certificates (PEM) of the authorities to trust instead of the system\'s [env: COVIS_CA]' -r -F
complete -c covis -n "__fish_covis_using_subcommand job; and __fish_seen_subcommand_from watch" -l cert -d 'The client\'s own certificate (PEM), for mutual TLS [env: COVIS_CERT]' -r -F
complete -c covis -n "__fish_covis_using_subcommand job; and __fish_seen_subcommand_from watch" -l key -d 'The private key of --cert (PEM) [env: COVIS_KEY]' -r -F
complete -c covis -n "__fish_covis_using_subcommand job; and __fish_seen_subcommand_from watch" -l token-file -d 'File that holds the bearer token; COVIS_TOKEN holds the token itself [env: COVIS_TOKEN_FILE]' -r -F
complete -c covis -n "__fish_covis_using_subcommand job; and __fish_seen_subcommand_from watch" -l server-wait -d 'Seconds to wait for a server that does not answer yet or still opens its maps; 0 fails at once [default: 10] [env: COVIS_SERVER_WAIT]' -r
complete -c covis -n "__fish_covis_using_subcommand job; and __fish_seen_subcommand_from watch" -l config -d 'Configuration file instead of ./covis.toml [env: COVIS_CONFIG]' -r -F
complete -c covis -n "__fish_covis_using_subcommand job; and __fish_seen_subcommand_from watch" -l log -d 'Log level (off, error, warn, info, debug, trace) or a list of them, `target=level` [default: info; warn of commands that do not write to a terminal] [env: COVIS_LOG]' -r
complete -c covis -n "__fish_covis_using_subcommand job; and __fish_seen_subcommand_from watch" -l log-format -d 'Format of log lines [default: text] [env: COVIS_LOG_FORMAT]' -r -f -a "text\t'For people'
json\t'One JSON object a line'"
complete -c covis -n "__fish_covis_using_subcommand job; and __fish_seen_subcommand_from watch" -l json -d 'Print JSON instead of text'
complete -c covis -n "__fish_covis_using_subcommand job; and __fish_seen_subcommand_from watch" -s h -l help -d 'Print help (see more with \'--help\')'
complete -c covis -n "__fish_covis_using_subcommand job; and __fish_seen_subcommand_from cancel" -l server -d 'The server\'s URL [default: http://127.0.0.1:7411] [env: COVIS_SERVER]' -r
complete -c covis -n "__fish_covis_using_subcommand job; and __fish_seen_subcommand_from cancel" -l ca -d 'Certificates (PEM) of the authorities to trust instead of the system\'s [env: COVIS_CA]' -r -F
complete -c covis -n "__fish_covis_using_subcommand job; and __fish_seen_subcommand_from cancel" -l cert -d 'The client\'s own certificate (PEM), for mutual TLS [env: COVIS_CERT]' -r -F
complete -c covis -n "__fish_covis_using_subcommand job; and __fish_seen_subcommand_from cancel" -l key -d 'The private key of --cert (PEM) [env: COVIS_KEY]' -r -F
complete -c covis -n "__fish_covis_using_subcommand job; and __fish_seen_subcommand_from cancel" -l token-file -d 'File that holds the bearer token; COVIS_TOKEN holds the token itself [env: COVIS_TOKEN_FILE]' -r -F
complete -c covis -n "__fish_covis_using_subcommand job; and __fish_seen_subcommand_from cancel" -l server-wait -d 'Seconds to wait for a server that does not answer yet or still opens its maps; 0 fails at once [default: 10] [env: COVIS_SERVER_WAIT]' -r
complete -c covis -n "__fish_covis_using_subcommand job; and __fish_seen_subcommand_from cancel" -l config -d 'Configuration file instead of ./covis.toml [env: COVIS_CONFIG]' -r -F
complete -c covis -n "__fish_covis_using_subcommand job; and __fish_seen_subcommand_from cancel" -l log -d 'Log level (off, error, warn, info, debug, trace) or a list of them, `target=level` [default: info; warn of commands that do not write to a terminal] [env: COVIS_LOG]' -r
complete -c covis -n "__fish_covis_using_subcommand job; and __fish_seen_subcommand_from cancel" -l log-format -d 'Format of log lines [default: text] [env: COVIS_LOG_FORMAT]' -r -f -a "text\t'For people'
json\t'One JSON object a line'"
complete -c covis -n "__fish_covis_using_subcommand job; and __fish_seen_subcommand_from cancel" -l json -d 'Print JSON instead of text'
complete -c covis -n "__fish_covis_using_subcommand job; and __fish_seen_subcommand_from cancel" -s h -l help -d 'Print help (see more with \'--help\')'
complete -c covis -n "__fish_covis_using_subcommand job; and __fish_seen_subcommand_from delete" -l server -d 'The server\'s URL [default: http://127.0.0.1:7411] [env: COVIS_SERVER]' -r
complete -c covis -n "__fish_covis_using_subcommand job; and __fish_seen_subcommand_from delete" -l ca -d 'Certificates (PEM) of the authorities to trust instead of the system\'s [env: COVIS_CA]' -r -F
complete -c covis -n "__fish_covis_using_subcommand job; and __fish_seen_subcommand_from delete" -l cert -d 'The client\'s own certificate (PEM), for mutual TLS [env: COVIS_CERT]' -r -F
complete -c covis -n "__fish_covis_using_subcommand job; and __fish_seen_subcommand_from delete" -l key -d 'The private key of --cert (PEM) [env: COVIS_KEY]' -r -F
complete -c covis -n "__fish_covis_using_subcommand job; and __fish_seen_subcommand_from delete" -l token-file -d 'File that holds the bearer token; COVIS_TOKEN holds the token itself [env: COVIS_TOKEN_FILE]' -r -F
complete -c covis -n "__fish_covis_using_subcommand job; and __fish_seen_subcommand_from delete" -l server-wait -d 'Seconds to wait for a server that does not answer yet or still opens its maps; 0 fails at once [default: 10] [env: COVIS_SERVER_WAIT]' -r
complete -c covis -n "__fish_covis_using_subcommand job; and __fish_seen_subcommand_from delete" -l config -d 'Configuration file instead of ./covis.toml [env: COVIS_CONFIG]' -r -F
complete -c covis -n "__fish_covis_using_subcommand job; and __fish_seen_subcommand_from delete" -l log -d 'Log level (off, error, warn, info, debug, trace) or a list of them, `target=level` [default: info; warn of commands that do not write to a terminal] [env: COVIS_LOG]' -r
complete -c covis -n "__fish_covis_using_subcommand job; and __fish_seen_subcommand_from delete" -l log-format -d 'Format of log lines [default: text] [env: COVIS_LOG_FORMAT]' -r -f -a "text\t'For people'
json\t'One JSON object a line'"
complete -c covis -n "__fish_covis_using_subcommand job; and __fish_seen_subcommand_from delete" -l json -d 'Print JSON instead of text'
complete -c covis -n "__fish_covis_using_subcommand job; and __fish_seen_subcommand_from delete" -s h -l help -d 'Print help (see more with \'--help\')'
complete -c covis -n "__fish_covis_using_subcommand job; and __fish_seen_subcommand_from rm" -l server -d 'The server\'s URL [default: http://127.0.0.1:7411] [env: COVIS_SERVER]' -r
complete -c covis -n "__fish_covis_using_subcommand job; and __fish_seen_subcommand_from rm" -l ca -d 'Certificates (PEM) of the authorities to trust instead of the system\'s [env: COVIS_CA]' -r -F
complete -c covis -n "__fish_covis_using_subcommand job; and __fish_seen_subcommand_from rm" -l cert -d 'The client\'s own certificate (PEM), for mutual TLS [env: COVIS_CERT]' -r -F
complete -c covis -n "__fish_covis_using_subcommand job; and __fish_seen_subcommand_from rm" -l key -d 'The private key of --cert (PEM) [env: COVIS_KEY]' -r -F
complete -c covis -n "__fish_covis_using_subcommand job; and __fish_seen_subcommand_from rm" -l token-file -d 'File that holds the bearer token; COVIS_TOKEN holds the token itself [env: COVIS_TOKEN_FILE]' -r -F
complete -c covis -n "__fish_covis_using_subcommand job; and __fish_seen_subcommand_from rm" -l server-wait -d 'Seconds to wait for a server that does not answer yet or still opens its maps; 0 fails at once [default: 10] [env: COVIS_SERVER_WAIT]' -r
complete -c covis -n "__fish_covis_using_subcommand job; and __fish_seen_subcommand_from rm" -l config -d 'Configuration file instead of ./covis.toml [env: COVIS_CONFIG]' -r -F
complete -c covis -n "__fish_covis_using_subcommand job; and __fish_seen_subcommand_from rm" -l log -d 'Log level (off, error, warn, info, debug, trace) or a list of them, `target=level` [default: info; warn of commands that do not write to a terminal] [env: COVIS_LOG]' -r
complete -c covis -n "__fish_covis_using_subcommand job; and __fish_seen_subcommand_from rm" -l log-format -d 'Format of log lines [default: text] [env: COVIS_LOG_FORMAT]' -r -f -a "text\t'For people'
json\t'One JSON object a line'"
complete -c covis -n "__fish_covis_using_subcommand job; and __fish_seen_subcommand_from rm" -l json -d 'Print JSON instead of text'
complete -c covis -n "__fish_covis_using_subcommand job; and __fish_seen_subcommand_from rm" -s h -l help -d 'Print help (see more with \'--help\')'
complete -c covis -n "__fish_covis_using_subcommand job; and __fish_seen_subcommand_from fetch" -l out -d 'The folder' -r -F
complete -c covis -n "__fish_covis_using_subcommand job; and __fish_seen_subcommand_from fetch" -l server -d 'The server\'s URL [default: http://127.0.0.1:7411] [env: COVIS_SERVER]' -r
complete -c covis -n "__fish_covis_using_subcommand job; and __fish_seen_subcommand_from fetch" -l ca -d 'Certificates (PEM) of the authorities to trust instead of the system\'s [env: COVIS_CA]' -r -F
complete -c covis -n "__fish_covis_using_subcommand job; and __fish_seen_subcommand_from fetch" -l cert -d 'The client\'s own certificate (PEM), for mutual TLS [env: COVIS_CERT]' -r -F
complete -c covis -n "__fish_covis_using_subcommand job; and __fish_seen_subcommand_from fetch" -l key -d 'The private key of --cert (PEM) [env: COVIS_KEY]' -r -F
complete -c covis -n "__fish_covis_using_subcommand job; and __fish_seen_subcommand_from fetch" -l token-file -d 'File that holds the bearer token; COVIS_TOKEN holds the token itself [env: COVIS_TOKEN_FILE]' -r -F
complete -c covis -n "__fish_covis_using_subcommand job; and __fish_seen_subcommand_from fetch" -l server-wait -d 'Seconds to wait for a server that does not answer yet or still opens its maps; 0 fails at once [default: 10] [env: COVIS_SERVER_WAIT]' -r
complete -c covis -n "__fish_covis_using_subcommand job; and __fish_seen_subcommand_from fetch" -l config -d 'Configuration file instead of ./covis.toml [env: COVIS_CONFIG]' -r -F
complete -c covis -n "__fish_covis_using_subcommand job; and __fish_seen_subcommand_from fetch" -l log -d 'Log level (off, error, warn, info, debug, trace) or a list of them, `target=level` [default: info; warn of commands that do not write to a terminal] [env: COVIS_LOG]' -r
complete -c covis -n "__fish_covis_using_subcommand job; and __fish_seen_subcommand_from fetch" -l log-format -d 'Format of log lines [default: text] [env: COVIS_LOG_FORMAT]' -r -f -a "text\t'For people'
json\t'One JSON object a line'"
complete -c covis -n "__fish_covis_using_subcommand job; and __fish_seen_subcommand_from fetch" -l force -d 'Replace files that are there'
complete -c covis -n "__fish_covis_using_subcommand job; and __fish_seen_subcommand_from fetch" -l json -d 'Print JSON instead of text'
complete -c covis -n "__fish_covis_using_subcommand job; and __fish_seen_subcommand_from fetch" -s h -l help -d 'Print help (see more with \'--help\')'
complete -c covis -n "__fish_covis_using_subcommand job; and __fish_seen_subcommand_from help" -f -a "submit" -d 'Create a job on a map of the server, or on files that are sent to it'
complete -c covis -n "__fish_covis_using_subcommand job; and __fish_seen_subcommand_from help" -f -a "list" -d 'List the jobs, the newest first'
complete -c covis -n "__fish_covis_using_subcommand job; and __fish_seen_subcommand_from help" -f -a "show" -d 'Show a job with its report'
complete -c covis -n "__fish_covis_using_subcommand job; and __fish_seen_subcommand_from help" -f -a "watch" -d 'Follow a job to its end and print a line at each change'
complete -c covis -n "__fish_covis_using_subcommand job; and __fish_seen_subcommand_from help" -f -a "cancel" -d 'Ask a job to stop without applying its result'
complete -c covis -n "__fish_covis_using_subcommand job; and __fish_seen_subcommand_from help" -f -a "delete" -d 'Delete a job that has ended, with its files'
complete -c covis -n "__fish_covis_using_subcommand job; and __fish_seen_subcommand_from help" -f -a "fetch" -d 'Write the files that a job made: the report, solved problems, an export'
complete -c covis -n "__fish_covis_using_subcommand job; and __fish_seen_subcommand_from help" -f -a "help" -d 'Print this message or the help of the given subcommand(s)'
complete -c covis -n "__fish_covis_using_subcommand load" -l maps -d 'Maps, each with its own client' -r
complete -c covis -n "__fish_covis_using_subcommand load" -l rate -d 'Keyframes per second of each client' -r
complete -c covis -n "__fish_covis_using_subcommand load" -l seconds -d 'How long to send' -r
complete -c covis -n "__fish_covis_using_subcommand load" -l observations -d 'Observations of each keyframe' -r
complete -c covis -n "__fish_covis_using_subcommand load" -l maps-per-connection -d 'Maps on one connection' -r
complete -c covis -n "__fish_covis_using_subcommand load" -l server -d 'The server\'s URL [default: http://127.0.0.1:7411] [env: COVIS_SERVER]' -r
complete -c covis -n "__fish_covis_using_subcommand load" -l ca -d 'Certificates (PEM) of the authorities to trust instead of the system\'s [env: COVIS_CA]' -r -F
complete -c covis -n "__fish_covis_using_subcommand load" -l cert -d 'The client\'s own certificate (PEM), for mutual TLS [env: COVIS_CERT]' -r -F
complete -c covis -n "__fish_covis_using_subcommand load" -l key -d 'The private key of --cert (PEM) [env: COVIS_KEY]' -r -F
complete -c covis -n "__fish_covis_using_subcommand load" -l token-file -d 'File that holds the bearer token; COVIS_TOKEN holds the token itself [env: COVIS_TOKEN_FILE]' -r -F
complete -c covis -n "__fish_covis_using_subcommand load" -l server-wait -d 'Seconds to wait for a server that does not answer yet or still opens its maps; 0 fails at once [default: 10] [env: COVIS_SERVER_WAIT]' -r
complete -c covis -n "__fish_covis_using_subcommand load" -l config -d 'Configuration file instead of ./covis.toml [env: COVIS_CONFIG]' -r -F
complete -c covis -n "__fish_covis_using_subcommand load" -l log -d 'Log level (off, error, warn, info, debug, trace) or a list of them, `target=level` [default: info; warn of commands that do not write to a terminal] [env: COVIS_LOG]' -r
complete -c covis -n "__fish_covis_using_subcommand load" -l log-format -d 'Format of log lines [default: text] [env: COVIS_LOG_FORMAT]' -r -f -a "text\t'For people'
json\t'One JSON object a line'"
complete -c covis -n "__fish_covis_using_subcommand load" -l json -d 'Print one JSON object instead of a table'
complete -c covis -n "__fish_covis_using_subcommand load" -s h -l help -d 'Print help (see more with \'--help\')'
complete -c covis -n "__fish_covis_using_subcommand map; and not __fish_seen_subcommand_from list ls show create set rename closures constraints freeze unfreeze edit merge unmerge snapshot restore delete rm export import help" -l server -d 'The server\'s URL [default: http://127.0.0.1:7411] [env: COVIS_SERVER]' -r
complete -c covis -n "__fish_covis_using_subcommand map; and not __fish_seen_subcommand_from list ls show create set rename closures constraints freeze unfreeze edit merge unmerge snapshot restore delete rm export import help" -l ca -d 'Certificates (PEM) of the authorities to trust instead of the system\'s [env: COVIS_CA]' -r -F
complete -c covis -n "__fish_covis_using_subcommand map; and not __fish_seen_subcommand_from list ls show create set rename closures constraints freeze unfreeze edit merge unmerge snapshot restore delete rm export import help" -l cert -d 'The client\'s own certificate (PEM), for mutual TLS [env: COVIS_CERT]' -r -F
complete -c covis -n "__fish_covis_using_subcommand map; and not __fish_seen_subcommand_from list ls show create set rename closures constraints freeze unfreeze edit merge unmerge snapshot restore delete rm export import help" -l key -d 'The private key of --cert (PEM) [env: COVIS_KEY]' -r -F
complete -c covis -n "__fish_covis_using_subcommand map; and not __fish_seen_subcommand_from list ls show create set rename closures constraints freeze unfreeze edit merge unmerge snapshot restore delete rm export import help" -l token-file -d 'File that holds the bearer token; COVIS_TOKEN holds the token itself [env: COVIS_TOKEN_FILE]' -r -F
complete -c covis -n "__fish_covis_using_subcommand map; and not __fish_seen_subcommand_from list ls show create set rename closures constraints freeze unfreeze edit merge unmerge snapshot restore delete rm export import help" -l server-wait -d 'Seconds to wait for a server that does not answer yet or still opens its maps; 0 fails at once [default: 10] [env: COVIS_SERVER_WAIT]' -r
complete -c covis -n "__fish_covis_using_subcommand map; and not __fish_seen_subcommand_from list ls show create set rename closures constraints freeze unfreeze edit merge unmerge snapshot restore delete rm export import help" -l config -d 'Configuration file instead of ./covis.toml [env: COVIS_CONFIG]' -r -F
complete -c covis -n "__fish_covis_using_subcommand map; and not __fish_seen_subcommand_from list ls show create set rename closures constraints freeze unfreeze edit merge unmerge snapshot restore delete rm export import help" -l log -d 'Log level (off, error, warn, info, debug, trace) or a list of them, `target=level` [default: info; warn of commands that do not write to a terminal] [env: COVIS_LOG]' -r
complete -c covis -n "__fish_covis_using_subcommand map; and not __fish_seen_subcommand_from list ls show create set rename closures constraints freeze unfreeze edit merge unmerge snapshot restore delete rm export import help" -l log-format -d 'Format of log lines [default: text] [env: COVIS_LOG_FORMAT]' -r -f -a "text\t'For people'
json\t'One JSON object a line'"
complete -c covis -n "__fish_covis_using_subcommand map; and not __fish_seen_subcommand_from list ls show create set rename closures constraints freeze unfreeze edit merge unmerge snapshot restore delete rm export import help" -l json -d 'Print JSON instead of text'
complete -c covis -n "__fish_covis_using_subcommand map; and not __fish_seen_subcommand_from list ls show create set rename closures constraints freeze unfreeze edit merge unmerge snapshot restore delete rm export import help" -s h -l help -d 'Print help (see more with \'--help\')'
complete -c covis -n "__fish_covis_using_subcommand map; and not __fish_seen_subcommand_from list ls show create set rename closures constraints freeze unfreeze edit merge unmerge snapshot restore delete rm export import help" -f -a "list" -d 'List all maps'
complete -c covis -n "__fish_covis_using_subcommand map; and not __fish_seen_subcommand_from list ls show create set rename closures constraints freeze unfreeze edit merge unmerge snapshot restore delete rm export import help" -f -a "ls" -d 'List all maps'
complete -c covis -n "__fish_covis_using_subcommand map; and not __fish_seen_subcommand_from list ls show create set rename closures constraints freeze unfreeze edit merge unmerge snapshot restore delete rm export import help" -f -a "show" -d 'Show one map: counts, clients, bounds'
complete -c covis -n "__fish_covis_using_subcommand map; and not __fish_seen_subcommand_from list ls show create set rename closures constraints freeze unfreeze edit merge unmerge snapshot restore delete rm export import help" -f -a "create" -d 'Create an empty map'
complete -c covis -n "__fish_covis_using_subcommand map; and not __fish_seen_subcommand_from list ls show create set rename closures constraints freeze unfreeze edit merge unmerge snapshot restore delete rm export import help" -f -a "set" -d 'Change the policy of a map, and print it'
complete -c covis -n "__fish_covis_using_subcommand map; and not __fish_seen_subcommand_from list ls show create set rename closures constraints freeze unfreeze edit merge unmerge snapshot restore delete rm export import help" -f -a "rename" -d 'Change the display name of a map. Its id never changes'
complete -c covis -n "__fish_covis_using_subcommand map; and not __fish_seen_subcommand_from list ls show create set rename closures constraints freeze unfreeze edit merge unmerge snapshot restore delete rm export import help" -f -a "closures" -d 'List where keyframes looked like earlier ones: the loop closures that the server added, and why others were refused'
complete -c covis -n "__fish_covis_using_subcommand map; and not __fish_seen_subcommand_from list ls show create set rename closures constraints freeze unfreeze edit merge unmerge snapshot restore delete rm export import help" -f -a "constraints" -d 'List the constraints of a map, and which of them are switched off'
complete -c covis -n "__fish_covis_using_subcommand map; and not __fish_seen_subcommand_from list ls show create set rename closures constraints freeze unfreeze edit merge unmerge snapshot restore delete rm export import help" -f -a "freeze" -d 'Freeze a map: it can be read but not changed until you unfreeze it'
complete -c covis -n "__fish_covis_using_subcommand map; and not __fish_seen_subcommand_from list ls show create set rename closures constraints freeze unfreeze edit merge unmerge snapshot restore delete rm export import help" -f -a "unfreeze" -d 'Unfreeze a map, so that it can be changed again'
complete -c covis -n "__fish_covis_using_subcommand map; and not __fish_seen_subcommand_from list ls show create set rename closures constraints freeze unfreeze edit merge unmerge snapshot restore delete rm export import help" -f -a "edit" -d 'Change or remove content of a map'
complete -c covis -n "__fish_covis_using_subcommand map; and not __fish_seen_subcommand_from list ls show create set rename closures constraints freeze unfreeze edit merge unmerge snapshot restore delete rm export import help" -f -a "merge" -d 'Merge a map into another one that shows the same places'
complete -c covis -n "__fish_covis_using_subcommand map; and not __fish_seen_subcommand_from list ls show create set rename closures constraints freeze unfreeze edit merge unmerge snapshot restore delete rm export import help" -f -a "unmerge" -d 'Take a map out of the one that it was merged into'
complete -c covis -n "__fish_covis_using_subcommand map; and not __fish_seen_subcommand_from list ls show create set rename closures constraints freeze unfreeze edit merge unmerge snapshot restore delete rm export import help" -f -a "snapshot" -d 'Copy a map as it is now into a new, frozen map'
complete -c covis -n "__fish_covis_using_subcommand map; and not __fish_seen_subcommand_from list ls show create set rename closures constraints freeze unfreeze edit merge unmerge snapshot restore delete rm export import help" -f -a "restore" -d 'Restore an earlier state of a map from its journal, into a new map'
complete -c covis -n "__fish_covis_using_subcommand map; and not __fish_seen_subcommand_from list ls show create set rename closures constraints freeze unfreeze edit merge unmerge snapshot restore delete rm export import help" -f -a "delete" -d 'Delete a map with its journal'
complete -c covis -n "__fish_covis_using_subcommand map; and not __fish_seen_subcommand_from list ls show create set rename closures constraints freeze unfreeze edit merge unmerge snapshot restore delete rm export import help" -f -a "rm" -d 'Delete a map with its journal'
complete -c covis -n "__fish_covis_using_subcommand map; and not __fish_seen_subcommand_from list ls show create set rename closures constraints freeze unfreeze edit merge unmerge snapshot restore delete rm export import help" -f -a "export" -d 'Write a map to files'
complete -c covis -n "__fish_covis_using_subcommand map; and not __fish_seen_subcommand_from list ls show create set rename closures constraints freeze unfreeze edit merge unmerge snapshot restore delete rm export import help" -f -a "import" -d 'Create a map from files: an export of covis, COLMAP, g2o, or a trajectory'
complete -c covis -n "__fish_covis_using_subcommand map; and not __fish_seen_subcommand_from list ls show create set rename closures constraints freeze unfreeze edit merge unmerge snapshot restore delete rm export import help" -f -a "help" -d 'Print this message or the help of the given subcommand(s)'
complete -c covis -n "__fish_covis_using_subcommand map; and __fish_seen_subcommand_from list" -l server -d 'The server\'s URL [default: http://127.0.0.1:7411] [env: COVIS_SERVER]' -r
complete -c covis -n "__fish_covis_using_subcommand map; and __fish_seen_subcommand_from list" -l ca -d 'Certificates (PEM) of the authorities to trust instead of the system\'s [env: COVIS_CA]' -r -F
complete -c covis -n "__fish_covis_using_subcommand map; and __fish_seen_subcommand_from list" -l cert -d 'The client\'s own certificate (PEM), for mutual TLS [env: COVIS_CERT]' -r -F
complete -c covis -n "__fish_covis_using_subcommand map; and __fish_seen_subcommand_from list" -l key -d 'The private key of --cert (PEM) [env: COVIS_KEY]' -r -F
complete -c covis -n "__fish_covis_using_subcommand map; and __fish_seen_subcommand_from list" -l token-file -d 'File that holds the bearer token; COVIS_TOKEN holds the token itself [env: COVIS_TOKEN_FILE]' -r -F
complete -c covis -n "__fish_covis_using_subcommand map; and __fish_seen_subcommand_from list" -l server-wait -d 'Seconds to wait for a server that does not answer yet or still opens its maps; 0 fails at once [default: 10] [env: COVIS_SERVER_WAIT]' -r
complete -c covis -n "__fish_covis_using_subcommand map; and __fish_seen_subcommand_from list" -l config -d 'Configuration file instead of ./covis.toml [env: COVIS_CONFIG]' -r -F
complete -c covis -n "__fish_covis_using_subcommand map; and __fish_seen_subcommand_from list" -l log -d 'Log level (off, error, warn, info, debug, trace) or a list of them, `target=level` [default: info; warn of commands that do not write to a terminal] [env: COVIS_LOG]' -r
complete -c covis -n "__fish_covis_using_subcommand map; and __fish_seen_subcommand_from list" -l log-format -d 'Format of log lines [default: text] [env: COVIS_LOG_FORMAT]' -r -f -a "text\t'For people'
json\t'One JSON object a line'"
complete -c covis -n "__fish_covis_using_subcommand map; and __fish_seen_subcommand_from list" -l json -d 'Print JSON instead of text'
complete -c covis -n "__fish_covis_using_subcommand map; and __fish_seen_subcommand_from list" -s h -l help -d 'Print help (see more with \'--help\')'
complete -c covis -n "__fish_covis_using_subcommand map; and __fish_seen_subcommand_from ls" -l server -d 'The server\'s URL [default: http://127.0.0.1:7411] [env: COVIS_SERVER]' -r
complete -c covis -n "__fish_covis_using_subcommand map; and __fish_seen_subcommand_from ls" -l ca -d 'Certificates (PEM) of the authorities to trust instead of the system\'s [env: COVIS_CA]' -r -F
complete -c covis -n "__fish_covis_using_subcommand map; and __fish_seen_subcommand_from ls" -l cert -d 'The client\'s own certificate (PEM), for mutual TLS [env: COVIS_CERT]' -r -F
complete -c covis -n "__fish_covis_using_subcommand map; and __fish_seen_subcommand_from ls" -l key -d 'The private key of --cert (PEM) [env: COVIS_KEY]' -r -F
complete -c covis -n "__fish_covis_using_subcommand map; and __fish_seen_subcommand_from ls" -l token-file -d 'File that holds the bearer token; COVIS_TOKEN holds the token itself [env: COVIS_TOKEN_FILE]' -r -F
complete -c covis -n "__fish_covis_using_subcommand map; and __fish_seen_subcommand_from ls" -l server-wait -d 'Seconds to wait for a server that does not answer yet or still opens its maps; 0 fails at once [default: 10] [env: COVIS_SERVER_WAIT]' -r
complete -c covis -n "__fish_covis_using_subcommand map; and __fish_seen_subcommand_from ls" -l config -d 'Configuration file instead of ./covis.toml [env: COVIS_CONFIG]' -r -F
complete -c covis -n "__fish_covis_using_subcommand map; and __fish_seen_subcommand_from ls" -l log -d 'Log level (off, error, warn, info, debug, trace) or a list of them, `target=level` [default: info; warn of commands that do not write to a terminal] [env: COVIS_LOG]' -r
complete -c covis -n "__fish_covis_using_subcommand map; and __fish_seen_subcommand_from ls" -l log-format -d 'Format of log lines [default: text] [env: COVIS_LOG_FORMAT]' -r -f -a "text\t'For people'
json\t'One JSON object a line'"
complete -c covis -n "__fish_covis_using_subcommand map; and __fish_seen_subcommand_from ls" -l json -d 'Print JSON instead of text'
complete -c covis -n "__fish_covis_using_subcommand map; and __fish_seen_subcommand_from ls" -s h -l help -d 'Print help (see more with \'--help\')'
complete -c covis -n "__fish_covis_using_subcommand map; and __fish_seen_subcommand_from show" -l server -d 'The server\'s URL [default: http://127.0.0.1:7411] [env: COVIS_SERVER]' -r
complete -c covis -n "__fish_covis_using_subcommand map; and __fish_seen_subcommand_from show" -l ca -d 'Certificates (PEM) of the authorities to trust instead of the system\'s [env: COVIS_CA]' -r -F
complete -c covis -n "__fish_covis_using_subcommand map; and __fish_seen_subcommand_from show" -l cert -d 'The client\'s own certificate (PEM), for mutual TLS [env: COVIS_CERT]' -r -F
complete -c covis -n "__fish_covis_using_subcommand map; and __fish_seen_subcommand_from show" -l key -d 'The private key of --cert (PEM) [env: COVIS_KEY]' -r -F
complete -c covis -n "__fish_covis_using_subcommand map; and __fish_seen_subcommand_from show" -l token-file -d 'File that holds the bearer token; COVIS_TOKEN holds the token itself [env: COVIS_TOKEN_FILE]' -r -F
complete -c covis -n "__fish_covis_using_subcommand map; and __fish_seen_subcommand_from show" -l server-wait -d 'Seconds to wait for a server that does not answer yet or still opens its maps; 0 fails at once [default: 10] [env: COVIS_SERVER_WAIT]' -r
complete -c covis -n "__fish_covis_using_subcommand map; and __fish_seen_subcommand_from show" -l config -d 'Configuration file instead of ./covis.toml [env: COVIS_CONFIG]' -r -F
complete -c covis -n "__fish_covis_using_subcommand map; and __fish_seen_subcommand_from show" -l log -d 'Log level (off, error, warn, info, debug, trace) or a list of them, `target=level` [default: info; warn of commands that do not write to a terminal] [env: COVIS_LOG]' -r
complete -c covis -n "__fish_covis_using_subcommand map; and __fish_seen_subcommand_from show" -l log-format -d 'Format of log lines [default: text] [env: COVIS_LOG_FORMAT]' -r -f -a "text\t'For people'
json\t'One JSON object a line'"
complete -c covis -n "__fish_covis_using_subcommand map; and __fish_seen_subcommand_from show" -l policy -d 'Print only its policy, as TOML that `covis map set --policy` takes'
complete -c covis -n "__fish_covis_using_subcommand map; and __fish_seen_subcommand_from show" -l json -d 'Print JSON instead of text'
complete -c covis -n "__fish_covis_using_subcommand map; and __fish_seen_subcommand_from show" -s h -l help -d 'Print help (see more with \'--help\')'
complete -c covis -n "__fish_covis_using_subcommand map; and __fish_seen_subcommand_from create" -l display-name -d 'Free text for people' -r
complete -c covis -n "__fish_covis_using_subcommand map; and __fish_seen_subcommand_from create" -l policy -d 'File (TOML) with fields of the map\'s policy; the others have the server\'s defaults' -r -F
complete -c covis -n "__fish_covis_using_subcommand map; and __fish_seen_subcommand_from create" -l server -d 'The server\'s URL [default: http://127.0.0.1:7411] [env: COVIS_SERVER]' -r
complete -c covis -n "__fish_covis_using_subcommand map; and __fish_seen_subcommand_from create" -l ca -d 'Certificates (PEM) of the authorities to trust instead of the system\'s [env: COVIS_CA]' -r -F
complete -c covis -n "__fish_covis_using_subcommand map; and __fish_seen_subcommand_from create" -l cert -d 'The client\'s own certificate (PEM), for mutual TLS [env: COVIS_CERT]' -r -F
complete -c covis -n "__fish_covis_using_subcommand map; and __fish_seen_subcommand_from create" -l key -d 'The private key of --cert (PEM) [env: COVIS_KEY]' -r -F
complete -c covis -n "__fish_covis_using_subcommand map; and __fish_seen_subcommand_from create" -l token-file -d 'File that holds the bearer token; COVIS_TOKEN holds the token itself [env: COVIS_TOKEN_FILE]' -r -F
complete -c covis -n "__fish_covis_using_subcommand map; and __fish_seen_subcommand_from create" -l server-wait -d 'Seconds to wait for a server that does not answer yet or still opens its maps; 0 fails at once [default: 10] [env: COVIS_SERVER_WAIT]' -r
complete -c covis -n "__fish_covis_using_subcommand map; and __fish_seen_subcommand_from create" -l config -d 'Configuration file instead of ./covis.toml [env: COVIS_CONFIG]' -r -F
complete -c covis -n "__fish_covis_using_subcommand map; and __fish_seen_subcommand_from create" -l log -d 'Log level (off, error, warn, info, debug, trace) or a list of them, `target=level` [default: info; warn of commands that do not write to a terminal] [env: COVIS_LOG]' -r
complete -c covis -n "__fish_covis_using_subcommand map; and __fish_seen_subcommand_from create" -l log-format -d 'Format of log lines [default: text] [env: COVIS_LOG_FORMAT]' -r -f -a "text\t'For people'
json\t'One JSON object a line'"
complete -c covis -n "__fish_covis_using_subcommand map; and __fish_seen_subcommand_from create" -l json -d 'Print JSON instead of text'
complete -c covis -n "__fish_covis_using_subcommand map; and __fish_seen_subcommand_from create" -s h -l help -d 'Print help (see more with \'--help\')'
complete -c covis -n "__fish_covis_using_subcommand map; and __fish_seen_subcommand_from set" -l policy -d 'File (TOML) with the fields of the policy that are to change; `covis map show NAME --policy` prints one' -r -F
complete -c covis -n "__fish_covis_using_subcommand map; and __fish_seen_subcommand_from set" -l reset -d 'A field of the policy that is to have the server\'s default, such as `gauge` or `limits.max_keyframe_count`' -r
complete -c covis -n "__fish_covis_using_subcommand map; and __fish_seen_subcommand_from set" -l server -d 'The server\'s URL [default: http://127.0.0.1:7411] [env: COVIS_SERVER]' -r
complete -c covis -n "__fish_covis_using_subcommand map; and __fish_seen_subcommand_from set" -l ca -d 'Certificates (PEM) of the authorities to trust instead of the system\'s [env: COVIS_CA]' -r -F
complete -c covis -n "__fish_covis_using_subcommand map; and __fish_seen_subcommand_from set" -l cert -d 'The client\'s own certificate (PEM), for mutual TLS [env: COVIS_CERT]' -r -F
complete -c covis -n "__fish_covis_using_subcommand map; and __fish_seen_subcommand_from set" -l key -d 'The private key of --cert (PEM) [env: COVIS_KEY]' -r -F
complete -c covis -n "__fish_covis_using_subcommand map; and __fish_seen_subcommand_from set" -l token-file -d 'File that holds the bearer token; COVIS_TOKEN holds the token itself [env: COVIS_TOKEN_FILE]' -r -F
complete -c covis -n "__fish_covis_using_subcommand map; and __fish_seen_subcommand_from set" -l server-wait -d 'Seconds to wait for a server that does not answer yet or still opens its maps; 0 fails at once [default: 10] [env: COVIS_SERVER_WAIT]' -r
complete -c covis -n "__fish_covis_using_subcommand map; and __fish_seen_subcommand_from set" -l config -d 'Configuration file instead of ./covis.toml [env: COVIS_CONFIG]' -r -F
complete -c covis -n "__fish_covis_using_subcommand map; and __fish_seen_subcommand_from set" -l log -d 'Log level (off, error, warn, info, debug, trace) or a list of them, `target=level` [default: info; warn of commands that do not write to a terminal] [env: COVIS_LOG]' -r
complete -c covis -n "__fish_covis_using_subcommand map; and __fish_seen_subcommand_from set" -l log-format -d 'Format of log lines [default: text] [env: COVIS_LOG_FORMAT]' -r -f -a "text\t'For people'
json\t'One JSON object a line'"
complete -c covis -n "__fish_covis_using_subcommand map; and __fish_seen_subcommand_from set" -l json -d 'Print JSON instead of text'
complete -c covis -n "__fish_covis_using_subcommand map; and __fish_seen_subcommand_from set" -s h -l help -d 'Print help (see more with \'--help\')'
complete -c covis -n "__fish_covis_using_subcommand map; and __fish_seen_subcommand_from rename" -l server -d 'The server\'s URL [default: http://127.0.0.1:7411] [env: COVIS_SERVER]' -r
complete -c covis -n "__fish_covis_using_subcommand map; and __fish_seen_subcommand_from rename" -l ca -d 'Certificates (PEM) of the authorities to trust instead of the system\'s [env: COVIS_CA]' -r -F
complete -c covis -n "__fish_covis_using_subcommand map; and __fish_seen_subcommand_from rename" -l cert -d 'The client\'s own certificate (PEM), for mutual TLS [env: COVIS_CERT]' -r -F
complete -c covis -n "__fish_covis_using_subcommand map; and __fish_seen_subcommand_from rename" -l key -d 'The private key of --cert (PEM) [env: COVIS_KEY]' -r -F
complete -c covis -n "__fish_covis_using_subcommand map; and __fish_seen_subcommand_from rename" -l token-file -d 'File that holds the bearer token; COVIS_TOKEN holds the token itself [env: COVIS_TOKEN_FILE]' -r -F
complete -c covis -n "__fish_covis_using_subcommand map; and __fish_seen_subcommand_from rename" -l server-wait -d 'Seconds to wait for a server that does not answer yet or still opens its maps; 0 fails at once [default: 10] [env: COVIS_SERVER_WAIT]' -r
complete -c covis -n "__fish_covis_using_subcommand map; and __fish_seen_subcommand_from rename" -l config -d 'Configuration file instead of ./covis.toml [env: COVIS_CONFIG]' -r -F
complete -c covis -n "__fish_covis_using_subcommand map; and __fish_seen_subcommand_from rename" -l log -d 'Log level (off, error, warn, info, debug, trace) or a list of them, `target=level` [default: info; warn of commands that do not write to a terminal] [env: COVIS_LOG]' -r
complete -c covis -n "__fish_covis_using_subcommand map; and __fish_seen_subcommand_from rename" -l log-format -d 'Format of log lines [default: text] [env: COVIS_LOG_FORMAT]' -r -f -a "text\t'For people'
json\t'One JSON object a line'"
complete -c covis -n "__fish_covis_using_subcommand map; and __fish_seen_subcommand_from rename" -l json -d 'Print JSON instead of text'
complete -c covis -n "__fish_covis_using_subcommand map; and __fish_seen_subcommand_from rename" -s h -l help -d 'Print help (see more with \'--help\')'
complete -c covis -n "__fish_covis_using_subcommand map; and __fish_seen_subcommand_from closures" -l server -d 'The server\'s URL [default: http://127.0.0.1:7411] [env: COVIS_SERVER]' -r
complete -c covis -n "__fish_covis_using_subcommand map; and __fish_seen_subcommand_from closures" -l ca -d 'Certificates (PEM) of the authorities to trust instead of the system\'s [env: COVIS_CA]' -r -F
complete -c covis -n "__fish_covis_using_subcommand map; and __fish_seen_subcommand_from closures" -l cert -d 'The client\'s own certificate (PEM), for mutual TLS [env: COVIS_CERT]' -r -F
complete -c covis -n "__fish_covis_using_subcommand map; and __fish_seen_subcommand_from closures" -l key -d 'The private key of --cert (PEM) [env: COVIS_KEY]' -r -F
complete -c covis -n "__fish_covis_using_subcommand map; and __fish_seen_subcommand_from closures" -l token-file -d 'File that holds the bearer token; COVIS_TOKEN holds the token itself [env: COVIS_TOKEN_FILE]' -r -F
complete -c covis -n "__fish_covis_using_subcommand map; and __fish_seen_subcommand_from closures" -l server-wait -d 'Seconds to wait for a server that does not answer yet or still opens its maps; 0 fails at once [default: 10] [env: COVIS_SERVER_WAIT]' -r
complete -c covis -n "__fish_covis_using_subcommand map; and __fish_seen_subcommand_from closures" -l config -d 'Configuration file instead of ./covis.toml [env: COVIS_CONFIG]' -r -F
complete -c covis -n "__fish_covis_using_subcommand map; and __fish_seen_subcommand_from closures" -l log -d 'Log level (off, error, warn, info, debug, trace) or a list of them, `target=level` [default: info; warn of commands that do not write to a terminal] [env: COVIS_LOG]' -r
complete -c covis -n "__fish_covis_using_subcommand map; and __fish_seen_subcommand_from closures" -l log-format -d 'Format of log lines [default: text] [env: COVIS_LOG_FORMAT]' -r -f -a "text\t'For people'
json\t'One JSON object a line'"
complete -c covis -n "__fish_covis_using_subcommand map; and __fish_seen_subcommand_from closures" -l json -d 'Print JSON instead of text'
complete -c covis -n "__fish_covis_using_subcommand map; and __fish_seen_subcommand_from closures" -s h -l help -d 'Print help (see more with \'--help\')'
complete -c covis -n "__fish_covis_using_subcommand map; and __fish_seen_subcommand_from constraints" -l server -d 'The server\'s URL [default: http://127.0.0.1:7411] [env: COVIS_SERVER]' -r
complete -c covis -n "__fish_covis_using_subcommand map; and __fish_seen_subcommand_from constraints" -l ca -d 'Certificates (PEM) of the authorities to trust instead of the system\'s [env: COVIS_CA]' -r -F
complete -c covis -n "__fish_covis_using_subcommand map; and __fish_seen_subcommand_from constraints" -l cert -d 'The client\'s own certificate (PEM), for mutual TLS [env: COVIS_CERT]' -r -F
complete -c covis -n "__fish_covis_using_subcommand map; and __fish_seen_subcommand_from constraints" -l key -d 'The private key of --cert (PEM) [env: COVIS_KEY]' -r -F
complete -c covis -n "__fish_covis_using_subcommand map; and __fish_seen_subcommand_from constraints" -l token-file -d 'File that holds the bearer token; COVIS_TOKEN holds the token itself [env: COVIS_TOKEN_FILE]' -r -F
complete -c covis -n "__fish_covis_using_subcommand map; and __fish_seen_subcommand_from constraints" -l server-wait -d 'Seconds to wait for a server that does not answer yet or still opens its maps; 0 fails at once [default: 10] [env: COVIS_SERVER_WAIT]' -r
complete -c covis -n "__fish_covis_using_subcommand map; and __fish_seen_subcommand_from constraints" -l config -d 'Configuration file instead of ./covis.toml [env: COVIS_CONFIG]' -r -F
complete -c covis -n "__fish_covis_using_subcommand map; and __fish_seen_subcommand_from constraints" -l log -d 'Log level (off, error, warn, info, debug, trace) or a list of them, `target=level` [default: info; warn of commands that do not write to a terminal] [env: COVIS_LOG]' -r
complete -c covis -n "__fish_covis_using_subcommand map; and __fish_seen_subcommand_from constraints" -l log-format -d 'Format of log lines [default: text] [env: COVIS_LOG_FORMAT]' -r -f -a "text\t'For people'
json\t'One JSON object a line'"
complete -c covis -n "__fish_covis_using_subcommand map; and __fish_seen_subcommand_from constraints" -l json -d 'Print JSON instead of text'
complete -c covis -n "__fish_covis_using_subcommand map; and __fish_seen_subcommand_from constraints" -s h -l help -d 'Print help (see more with \'--help\')'
complete -c covis -n "__fish_covis_using_subcommand map; and __fish_seen_subcommand_from freeze" -l server -d 'The server\'s URL [default: http://127.0.0.1:7411] [env: COVIS_SERVER]' -r
complete -c covis -n "__fish_covis_using_subcommand map; and __fish_seen_subcommand_from freeze" -l ca -d 'Certificates (PEM) of the authorities to trust instead of the system\'s [env: COVIS_CA]' -r -F
complete -c covis -n "__fish_covis_using_subcommand map; and __fish_seen_subcommand_from freeze" -l cert -d 'The client\'s own certificate (PEM), for mutual TLS [env: COVIS_CERT]' -r -F
complete -c covis -n "__fish_covis_using_subcommand map; and __fish_seen_subcommand_from freeze" -l key -d 'The private key of --cert (PEM) [env: COVIS_KEY]' -r -F
complete -c covis -n "__fish_covis_using_subcommand map; and __fish_seen_subcommand_from freeze" -l token-file -d 'File that holds the bearer token; COVIS_TOKEN holds the token itself [env: COVIS_TOKEN_FILE]' -r -F
complete -c covis -n "__fish_covis_using_subcommand map; and __fish_seen_subcommand_from freeze" -l server-wait -d 'Seconds to wait for a server that does not answer yet or still opens its maps; 0 fails at once [default: 10] [env: COVIS_SERVER_WAIT]' -r
complete -c covis -n "__fish_covis_using_subcommand map; and __fish_seen_subcommand_from freeze" -l config -d 'Configuration file instead of ./covis.toml [env: COVIS_CONFIG]' -r -F
complete -c covis -n "__fish_covis_using_subcommand map; and __fish_seen_subcommand_from freeze" -l log -d 'Log level (off, error, warn, info, debug, trace) or a list of them, `target=level` [default: info; warn of commands that do not write to a terminal] [env: COVIS_LOG]' -r
complete -c covis -n "__fish_covis_using_subcommand map; and __fish_seen_subcommand_from freeze" -l log-format -d 'Format of log lines [default: text] [env: COVIS_LOG_FORMAT]' -r -f -a "text\t'For people'
json\t'One JSON object a line'"
complete -c covis -n "__fish_covis_using_subcommand map; and __fish_seen_subcommand_from freeze" -l json -d 'Print JSON instead of text'
complete -c covis -n "__fish_covis_using_subcommand map; and __fish_seen_subcommand_from freeze" -s h -l help -d 'Print help (see more with \'--help\')'
complete -c covis -n "__fish_covis_using_subcommand map; and __fish_seen_subcommand_from unfreeze" -l server -d 'The server\'s URL [default: http://127.0.0.1:7411] [env: COVIS_SERVER]' -r
complete -c covis -n "__fish_covis_using_subcommand map; and __fish_seen_subcommand_from unfreeze" -l ca -d 'Certificates (PEM) of the authorities to trust instead of the system\'s [env: COVIS_CA]' -r -F
complete -c covis -n "__fish_covis_using_subcommand map; and __fish_seen_subcommand_from unfreeze" -l cert -d 'The client\'s own certificate (PEM), for mutual TLS [env: COVIS_CERT]' -r -F
complete -c covis -n "__fish_covis_using_subcommand map; and __fish_seen_subcommand_from unfreeze" -l key -d 'The private key of --cert (PEM) [env: COVIS_KEY]' -r -F
complete -c covis -n "__fish_covis_using_subcommand map; and __fish_seen_subcommand_from unfreeze" -l token-file -d 'File that holds the bearer token; COVIS_TOKEN holds the token itself [env: COVIS_TOKEN_FILE]' -r -F
complete -c covis -n "__fish_covis_using_subcommand map; and __fish_seen_subcommand_from unfreeze" -l server-wait -d 'Seconds to wait for a server that does not answer yet or still opens its maps; 0 fails at once [default: 10] [env: COVIS_SERVER_WAIT]' -r
complete -c covis -n "__fish_covis_using_subcommand map; and __fish_seen_subcommand_from unfreeze" -l config -d 'Configuration file instead of ./covis.toml [env: COVIS_CONFIG]' -r -F
complete -c covis -n "__fish_covis_using_subcommand map; and __fish_seen_subcommand_from unfreeze" -l log -d 'Log level (off, error, warn, info, debug, trace) or a list of them, `target=level` [default: info; warn of commands that do not write to a terminal] [env: COVIS_LOG]' -r
complete -c covis -n "__fish_covis_using_subcommand map; and __fish_seen_subcommand_from unfreeze" -l log-format -d 'Format of log lines [default: text] [env: COVIS_LOG_FORMAT]' -r -f -a "text\t'For people'
json\t'One JSON object a line'"
complete -c covis -n "__fish_covis_using_subcommand map; and __fish_seen_subcommand_from unfreeze" -l json -d 'Print JSON instead of text'
complete -c covis -n "__fish_covis_using_subcommand map; and __fish_seen_subcommand_from unfreeze" -s h -l help -d 'Print help (see more with \'--help\')'
complete -c covis -n "__fish_covis_using_subcommand map; and __fish_seen_subcommand_from edit" -l client -d 'The client name under which the edit is sent. Do not use the name of a robot: opening a stream ends another one that is open under the same name' -r
complete -c covis -n "__fish_covis_using_subcommand map; and __fish_seen_subcommand_from edit" -l server -d 'The server\'s URL [default: http://127.0.0.1:7411] [env: COVIS_SERVER]' -r
complete -c covis -n "__fish_covis_using_subcommand map; and __fish_seen_subcommand_from edit" -l ca -d 'Certificates (PEM) of the authorities to trust instead of the system\'s [env: COVIS_CA]' -r -F
complete -c covis -n "__fish_covis_using_subcommand map; and __fish_seen_subcommand_from edit" -l cert -d 'The client\'s own certificate (PEM), for mutual TLS [env: COVIS_CERT]' -r -F
complete -c covis -n "__fish_covis_using_subcommand map; and __fish_seen_subcommand_from edit" -l key -d 'The private key of --cert (PEM) [env: COVIS_KEY]' -r -F
complete -c covis -n "__fish_covis_using_subcommand map; and __fish_seen_subcommand_from edit" -l token-file -d 'File that holds the bearer token; COVIS_TOKEN holds the token itself [env: COVIS_TOKEN_FILE]' -r -F
complete -c covis -n "__fish_covis_using_subcommand map; and __fish_seen_subcommand_from edit" -l server-wait -d 'Seconds to wait for a server that does not answer yet or still opens its maps; 0 fails at once [default: 10] [env: COVIS_SERVER_WAIT]' -r
complete -c covis -n "__fish_covis_using_subcommand map; and __fish_seen_subcommand_from edit" -l config -d 'Configuration file instead of ./covis.toml [env: COVIS_CONFIG]' -r -F
complete -c covis -n "__fish_covis_using_subcommand map; and __fish_seen_subcommand_from edit" -l log -d 'Log level (off, error, warn, info, debug, trace) or a list of them, `target=level` [default: info; warn of commands that do not write to a terminal] [env: COVIS_LOG]' -r
complete -c covis -n "__fish_covis_using_subcommand map; and __fish_seen_subcommand_from edit" -l log-format -d 'Format of log lines [default: text] [env: COVIS_LOG_FORMAT]' -r -f -a "text\t'For people'
json\t'One JSON object a line'"
complete -c covis -n "__fish_covis_using_subcommand map; and __fish_seen_subcommand_from edit" -l optimized -d 'Also wait until the solves that the edit starts have ended'
complete -c covis -n "__fish_covis_using_subcommand map; and __fish_seen_subcommand_from edit" -l json -d 'Print JSON instead of text'
complete -c covis -n "__fish_covis_using_subcommand map; and __fish_seen_subcommand_from edit" -s h -l help -d 'Print help (see more with \'--help\')'
complete -c covis -n "__fish_covis_using_subcommand map; and __fish_seen_subcommand_from edit" -a "revoke-constraint" -d 'Remove a constraint or prior'
complete -c covis -n "__fish_covis_using_subcommand map; and __fish_seen_subcommand_from edit" -a "remove-observations" -d 'Remove a keyframe\'s observations of landmarks'
complete -c covis -n "__fish_covis_using_subcommand map; and __fish_seen_subcommand_from edit" -a "fuse-landmarks" -d 'Fuse several landmarks into one'
complete -c covis -n "__fish_covis_using_subcommand map; and __fish_seen_subcommand_from edit" -a "remove-landmarks" -d 'Remove landmarks with their observations'
complete -c covis -n "__fish_covis_using_subcommand map; and __fish_seen_subcommand_from edit" -a "remove-keyframe" -d 'Remove a keyframe with its observations, constraints and priors'
complete -c covis -n "__fish_covis_using_subcommand map; and __fish_seen_subcommand_from edit" -a "set-camera" -d 'Replace the model of a camera'
complete -c covis -n "__fish_covis_using_subcommand map; and __fish_seen_subcommand_from edit" -a "help" -d 'Print this message or the help of the given subcommand(s)'
complete -c covis -n "__fish_covis_using_subcommand map; and __fish_seen_subcommand_from merge" -l rename -d 'A new name for a client of the source, if the target already has a client of that name' -r
complete -c covis -n "__fish_covis_using_subcommand map; and __fish_seen_subcommand_from merge" -l server -d 'The server\'s URL [default: http://127.0.0.1:7411] [env: COVIS_SERVER]' -r
complete -c covis -n "__fish_covis_using_subcommand map; and __fish_seen_subcommand_from merge" -l ca -d 'Certificates (PEM) of the authorities to trust instead of the system\'s [env: COVIS_CA]' -r -F
complete -c covis -n "__fish_covis_using_subcommand map; and __fish_seen_subcommand_from merge" -l cert -d 'The client\'s own certificate (PEM), for mutual TLS [env: COVIS_CERT]' -r -F
complete -c covis -n "__fish_covis_using_subcommand map; and __fish_seen_subcommand_from merge" -l key -d 'The private key of --cert (PEM) [env: COVIS_KEY]' -r -F
complete -c covis -n "__fish_covis_using_subcommand map; and __fish_seen_subcommand_from merge" -l token-file -d 'File that holds the bearer token; COVIS_TOKEN holds the token itself [env: COVIS_TOKEN_FILE]' -r -F
complete -c covis -n "__fish_covis_using_subcommand map; and __fish_seen_subcommand_from merge" -l server-wait -d 'Seconds to wait for a server that does not answer yet or still opens its maps; 0 fails at once [default: 10] [env: COVIS_SERVER_WAIT]' -r
complete -c covis -n "__fish_covis_using_subcommand map; and __fish_seen_subcommand_from merge" -l config -d 'Configuration file instead of ./covis.toml [env: COVIS_CONFIG]' -r -F
complete -c covis -n "__fish_covis_using_subcommand map; and __fish_seen_subcommand_from merge" -l log -d 'Log level (off, error, warn, info, debug, trace) or a list of them, `target=level` [default: info; warn of commands that do not write to a terminal] [env: COVIS_LOG]' -r
complete -c covis -n "__fish_covis_using_subcommand map; and __fish_seen_subcommand_from merge" -l log-format -d 'Format of log lines [default: text] [env: COVIS_LOG_FORMAT]' -r -f -a "text\t'For people'
json\t'One JSON object a line'"
complete -c covis -n "__fish_covis_using_subcommand map; and __fish_seen_subcommand_from merge" -l json -d 'Print JSON instead of text'
complete -c covis -n "__fish_covis_using_subcommand map; and __fish_seen_subcommand_from merge" -s h -l help -d 'Print help (see more with \'--help\')'
complete -c covis -n "__fish_covis_using_subcommand map; and __fish_seen_subcommand_from unmerge" -l server -d 'The server\'s URL [default: http://127.0.0.1:7411] [env: COVIS_SERVER]' -r
complete -c covis -n "__fish_covis_using_subcommand map; and __fish_seen_subcommand_from unmerge" -l ca -d 'Certificates (PEM) of the authorities to trust instead of the system\'s [env: COVIS_CA]' -r -F
complete -c covis -n "__fish_covis_using_subcommand map; and __fish_seen_subcommand_from unmerge" -l cert -d 'The client\'s own certificate (PEM), for mutual TLS [env: COVIS_CERT]' -r -F
complete -c covis -n "__fish_covis_using_subcommand map; and __fish_seen_subcommand_from unmerge" -l key -d 'The private key of --cert (PEM) [env: COVIS_KEY]' -r -F
complete -c covis -n "__fish_covis_using_subcommand map; and __fish_seen_subcommand_from unmerge" -l token-file -d 'File that holds the bearer token; COVIS_TOKEN holds the token itself [env: COVIS_TOKEN_FILE]' -r -F
complete -c covis -n "__fish_covis_using_subcommand map; and __fish_seen_subcommand_from unmerge" -l server-wait -d 'Seconds to wait for a server that does not answer yet or still opens its maps; 0 fails at once [default: 10] [env: COVIS_SERVER_WAIT]' -r
complete -c covis -n "__fish_covis_using_subcommand map; and __fish_seen_subcommand_from unmerge" -l config -d 'Configuration file instead of ./covis.toml [env: COVIS_CONFIG]' -r -F
complete -c covis -n "__fish_covis_using_subcommand map; and __fish_seen_subcommand_from unmerge" -l log -d 'Log level (off, error, warn, info, debug, trace) or a list of them, `target=level` [default: info; warn of commands that do not write to a terminal] [env: COVIS_LOG]' -r
complete -c covis -n "__fish_covis_using_subcommand map; and __fish_seen_subcommand_from unmerge" -l log-format -d 'Format of log lines [default: text] [env: COVIS_LOG_FORMAT]' -r -f -a "text\t'For people'
json\t'One JSON object a line'"
complete -c covis -n "__fish_covis_using_subcommand map; and __fish_seen_subcommand_from unmerge" -l json -d 'Print JSON instead of text'
complete -c covis -n "__fish_covis_using_subcommand map; and __fish_seen_subcommand_from unmerge" -s h -l help -d 'Print help (see more with \'--help\')'
complete -c covis -n "__fish_covis_using_subcommand map; and __fish_seen_subcommand_from snapshot" -l server -d 'The server\'s URL [default: http://127.0.0.1:7411] [env: COVIS_SERVER]' -r
complete -c covis -n "__fish_covis_using_subcommand map; and __fish_seen_subcommand_from snapshot" -l ca -d 'Certificates (PEM) of the authorities to trust instead of the system\'s [env: COVIS_CA]' -r -F
complete -c covis -n "__fish_covis_using_subcommand map; and __fish_seen_subcommand_from snapshot" -l cert -d 'The client\'s own certificate (PEM), for mutual TLS [env: COVIS_CERT]' -r -F
complete -c covis -n "__fish_covis_using_subcommand map; and __fish_seen_subcommand_from snapshot" -l key -d 'The private key of --cert (PEM) [env: COVIS_KEY]' -r -F
complete -c covis -n "__fish_covis_using_subcommand map; and __fish_seen_subcommand_from snapshot" -l token-file -d 'File that holds the bearer token; COVIS_TOKEN holds the token itself [env: COVIS_TOKEN_FILE]' -r -F
complete -c covis -n "__fish_covis_using_subcommand map; and __fish_seen_subcommand_from snapshot" -l server-wait -d 'Seconds to wait for a server that does not answer yet or still opens its maps; 0 fails at once [default: 10] [env: COVIS_SERVER_WAIT]' -r
complete -c covis -n "__fish_covis_using_subcommand map; and __fish_seen_subcommand_from snapshot" -l config -d 'Configuration file instead of ./covis.toml [env: COVIS_CONFIG]' -r -F
complete -c covis -n "__fish_covis_using_subcommand map; and __fish_seen_subcommand_from snapshot" -l log -d 'Log level (off, error, warn, info, debug, trace) or a list of them, `target=level` [default: info; warn of commands that do not write to a terminal] [env: COVIS_LOG]' -r
complete -c covis -n "__fish_covis_using_subcommand map; and __fish_seen_subcommand_from snapshot" -l log-format -d 'Format of log lines [default: text] [env: COVIS_LOG_FORMAT]' -r -f -a "text\t'For people'
json\t'One JSON object a line'"
complete -c covis -n "__fish_covis_using_subcommand map; and __fish_seen_subcommand_from snapshot" -l json -d 'Print JSON instead of text'
complete -c covis -n "__fish_covis_using_subcommand map; and __fish_seen_subcommand_from snapshot" -s h -l help -d 'Print help (see more with \'--help\')'
complete -c covis -n "__fish_covis_using_subcommand map; and __fish_seen_subcommand_from restore" -l at -d 'The state of the map to restore: a revision, or a time such as 2026-03-01T12:00:00Z (RFC 3339)' -r
complete -c covis -n "__fish_covis_using_subcommand map; and __fish_seen_subcommand_from restore" -l server -d 'The server\'s URL [default: http://127.0.0.1:7411] [env: COVIS_SERVER]' -r
complete -c covis -n "__fish_covis_using_subcommand map; and __fish_seen_subcommand_from restore" -l ca -d 'Certificates (PEM) of the authorities to trust instead of the system\'s [env: COVIS_CA]' -r -F
complete -c covis -n "__fish_covis_using_subcommand map; and __fish_seen_subcommand_from restore" -l cert -d 'The client\'s own certificate (PEM), for mutual TLS [env: COVIS_CERT]' -r -F
complete -c covis -n "__fish_covis_using_subcommand map; and __fish_seen_subcommand_from restore" -l key -d 'The private key of --cert (PEM) [env: COVIS_KEY]' -r -F
complete -c covis -n "__fish_covis_using_subcommand map; and __fish_seen_subcommand_from restore" -l token-file -d 'File that holds the bearer token; COVIS_TOKEN holds the token itself [env: COVIS_TOKEN_FILE]' -r -F
complete -c covis -n "__fish_covis_using_subcommand map; and __fish_seen_subcommand_from restore" -l server-wait -d 'Seconds to wait for a server that does not answer yet or still opens its maps; 0 fails at once [default: 10] [env: COVIS_SERVER_WAIT]' -r
complete -c covis -n "__fish_covis_using_subcommand map; and __fish_seen_subcommand_from restore" -l config -d 'Configuration file instead of ./covis.toml [env: COVIS_CONFIG]' -r -F
complete -c covis -n "__fish_covis_using_subcommand map; and __fish_seen_subcommand_from restore" -l log -d 'Log level (off, error, warn, info, debug, trace) or a list of them, `target=level` [default: info; warn of commands that do not write to a terminal] [env: COVIS_LOG]' -r
complete -c covis -n "__fish_covis_using_subcommand map; and __fish_seen_subcommand_from restore" -l log-format -d 'Format of log lines [default: text] [env: COVIS_LOG_FORMAT]' -r -f -a "text\t'For people'
json\t'One JSON object a line'"
complete -c covis -n "__fish_covis_using_subcommand map; and __fish_seen_subcommand_from restore" -l json -d 'Print JSON instead of text'
complete -c covis -n "__fish_covis_using_subcommand map; and __fish_seen_subcommand_from restore" -s h -l help -d 'Print help (see more with \'--help\')'
complete -c covis -n "__fish_covis_using_subcommand map; and __fish_seen_subcommand_from delete" -l server -d 'The server\'s URL [default: http://127.0.0.1:7411] [env: COVIS_SERVER]' -r
complete -c covis -n "__fish_covis_using_subcommand map; and __fish_seen_subcommand_from delete" -l ca -d 'Certificates (PEM) of the authorities to trust instead of the system\'s [env: COVIS_CA]' -r -F
complete -c covis -n "__fish_covis_using_subcommand map; and __fish_seen_subcommand_from delete" -l cert -d 'The client\'s own certificate (PEM), for mutual TLS [env: COVIS_CERT]' -r -F
complete -c covis -n "__fish_covis_using_subcommand map; and __fish_seen_subcommand_from delete" -l key -d 'The private key of --cert (PEM) [env: COVIS_KEY]' -r -F
complete -c covis -n "__fish_covis_using_subcommand map; and __fish_seen_subcommand_from delete" -l token-file -d 'File that holds the bearer token; COVIS_TOKEN holds the token itself [env: COVIS_TOKEN_FILE]' -r -F
complete -c covis -n "__fish_covis_using_subcommand map; and __fish_seen_subcommand_from delete" -l server-wait -d 'Seconds to wait for a server that does not answer yet or still opens its maps; 0 fails at once [default: 10] [env: COVIS_SERVER_WAIT]' -r
complete -c covis -n "__fish_covis_using_subcommand map; and __fish_seen_subcommand_from delete" -l config -d 'Configuration file instead of ./covis.toml [env: COVIS_CONFIG]' -r -F
complete -c covis -n "__fish_covis_using_subcommand map; and __fish_seen_subcommand_from delete" -l log -d 'Log level (off, error, warn, info, debug, trace) or a list of them, `target=level` [default: info; warn of commands that do not write to a terminal] [env: COVIS_LOG]' -r
complete -c covis -n "__fish_covis_using_subcommand map; and __fish_seen_subcommand_from delete" -l log-format -d 'Format of log lines [default: text] [env: COVIS_LOG_FORMAT]' -r -f -a "text\t'For people'
json\t'One JSON object a line'"
complete -c covis -n "__fish_covis_using_subcommand map; and __fish_seen_subcommand_from delete" -l json -d 'Print JSON instead of text'
complete -c covis -n "__fish_covis_using_subcommand map; and __fish_seen_subcommand_from delete" -s h -l help -d 'Print help (see more with \'--help\')'
complete -c covis -n "__fish_covis_using_subcommand map; and __fish_seen_subcommand_from rm" -l server -d 'The server\'s URL [default: http://127.0.0.1:7411] [env: COVIS_SERVER]' -r
complete -c covis -n "__fish_covis_using_subcommand map; and __fish_seen_subcommand_from rm" -l ca -d 'Certificates (PEM) of the authorities to trust instead of the system\'s [env: COVIS_CA]' -r -F
complete -c covis -n "__fish_covis_using_subcommand map; and __fish_seen_subcommand_from rm" -l cert -d 'The client\'s own certificate (PEM), for mutual TLS [env: COVIS_CERT]' -r -F
complete -c covis -n "__fish_covis_using_subcommand map; and __fish_seen_subcommand_from rm" -l key -d 'The private key of --cert (PEM) [env: COVIS_KEY]' -r -F
complete -c covis -n "__fish_covis_using_subcommand map; and __fish_seen_subcommand_from rm" -l token-file -d 'File that holds the bearer token; COVIS_TOKEN holds the token itself [env: COVIS_TOKEN_FILE]' -r -F
complete -c covis -n "__fish_covis_using_subcommand map; and __fish_seen_subcommand_from rm" -l server-wait -d 'Seconds to wait for a server that does not answer yet or still opens its maps; 0 fails at once [default: 10] [env: COVIS_SERVER_WAIT]' -r
complete -c covis -n "__fish_covis_using_subcommand map; and __fish_seen_subcommand_from rm" -l config -d 'Configuration file instead of ./covis.toml [env: COVIS_CONFIG]' -r -F
complete -c covis -n "__fish_covis_using_subcommand map; and __fish_seen_subcommand_from rm" -l log -d 'Log level (off, error, warn, info, debug, trace) or a list of them, `target=level` [default: info; warn of commands that do not write to a terminal] [env: COVIS_LOG]' -r
complete -c covis -n "__fish_covis_using_subcommand map; and __fish_seen_subcommand_from rm" -l log-format -d 'Format of log lines [default: text] [env: COVIS_LOG_FORMAT]' -r -f -a "text\t'For people'
json\t'One JSON object a line'"
complete -c covis -n "__fish_covis_using_subcommand map; and __fish_seen_subcommand_from rm" -l json -d 'Print JSON instead of text'
complete -c covis -n "__fish_covis_using_subcommand map; and __fish_seen_subcommand_from rm" -s h -l help -d 'Print help (see more with \'--help\')'
complete -c covis -n "__fish_covis_using_subcommand map; and __fish_seen_subcommand_from export" -l format -d 'Format of the files [default: by the name of PATH; a name without extension is a COLMAP folder]' -r -f -a "colmap-text\t'COLMAP sparse model as text'
colmap-binary\t'COLMAP sparse model in binary'
tum\t'TUM trajectories'
kitti\t'KITTI\'s poses, without times'
euroc\t'Trajectories as EuRoC\'s ground truth; the body is the camera'
g2o\t'Pose graph as the server solves it: relative poses that keyframes measure, and constraints that are not switched off. `covis solve pose-graph` finds the same poses'
ply\t'Landmarks and trajectories for viewers; cannot be imported'
covis\t'All of the map, to move it to another server'"
complete -c covis -n "__fish_covis_using_subcommand map; and __fish_seen_subcommand_from export" -l out -d 'The file to write, or a folder if there are several (COLMAP\'s three, trajectories of several clients)' -r -F
complete -c covis -n "__fish_covis_using_subcommand map; and __fish_seen_subcommand_from export" -l server -d 'The server\'s URL [default: http://127.0.0.1:7411] [env: COVIS_SERVER]' -r
complete -c covis -n "__fish_covis_using_subcommand map; and __fish_seen_subcommand_from export" -l ca -d 'Certificates (PEM) of the authorities to trust instead of the system\'s [env: COVIS_CA]' -r -F
complete -c covis -n "__fish_covis_using_subcommand map; and __fish_seen_subcommand_from export" -l cert -d 'The client\'s own certificate (PEM), for mutual TLS [env: COVIS_CERT]' -r -F
complete -c covis -n "__fish_covis_using_subcommand map; and __fish_seen_subcommand_from export" -l key -d 'The private key of --cert (PEM) [env: COVIS_KEY]' -r -F
complete -c covis -n "__fish_covis_using_subcommand map; and __fish_seen_subcommand_from export" -l token-file -d 'File that holds the bearer token; COVIS_TOKEN holds the token itself [env: COVIS_TOKEN_FILE]' -r -F
complete -c covis -n "__fish_covis_using_subcommand map; and __fish_seen_subcommand_from export" -l server-wait -d 'Seconds to wait for a server that does not answer yet or still opens its maps; 0 fails at once [default: 10] [env: COVIS_SERVER_WAIT]' -r
complete -c covis -n "__fish_covis_using_subcommand map; and __fish_seen_subcommand_from export" -l config -d 'Configuration file instead of ./covis.toml [env: COVIS_CONFIG]' -r -F
complete -c covis -n "__fish_covis_using_subcommand map; and __fish_seen_subcommand_from export" -l log -d 'Log level (off, error, warn, info, debug, trace) or a list of them, `target=level` [default: info; warn of commands that do not write to a terminal] [env: COVIS_LOG]' -r
complete -c covis -n "__fish_covis_using_subcommand map; and __fish_seen_subcommand_from export" -l log-format -d 'Format of log lines [default: text] [env: COVIS_LOG_FORMAT]' -r -f -a "text\t'For people'
json\t'One JSON object a line'"
complete -c covis -n "__fish_covis_using_subcommand map; and __fish_seen_subcommand_from export" -l force -d 'Replace files that are there'
complete -c covis -n "__fish_covis_using_subcommand map; and __fish_seen_subcommand_from export" -l all-points -d 'COLMAP: also write the points that fewer than two keyframes observe. COLMAP\'s bundle adjustment refuses such points'
complete -c covis -n "__fish_covis_using_subcommand map; and __fish_seen_subcommand_from export" -l json -d 'Print JSON instead of text'
complete -c covis -n "__fish_covis_using_subcommand map; and __fish_seen_subcommand_from export" -s h -l help -d 'Print help (see more with \'--help\')'
complete -c covis -n "__fish_covis_using_subcommand map; and __fish_seen_subcommand_from import" -l format -d 'Format of the files [default: detected from their names]' -r -f -a "colmap-text\t'COLMAP sparse model as text'
colmap-binary\t'COLMAP sparse model in binary'
tum\t'TUM trajectories'
kitti\t'KITTI\'s poses, without times'
euroc\t'Trajectories as EuRoC\'s ground truth; the body is the camera'
g2o\t'Pose graph as the server solves it: relative poses that keyframes measure, and constraints that are not switched off. `covis solve pose-graph` finds the same poses'
ply\t'Landmarks and trajectories for viewers; cannot be imported'
covis\t'All of the map, to move it to another server'"
complete -c covis -n "__fish_covis_using_subcommand map; and __fish_seen_subcommand_from import" -l client -d 'Owner of the imported entities, if the format has no clients' -r
complete -c covis -n "__fish_covis_using_subcommand map; and __fish_seen_subcommand_from import" -l server -d 'The server\'s URL [default: http://127.0.0.1:7411] [env: COVIS_SERVER]' -r
complete -c covis -n "__fish_covis_using_subcommand map; and __fish_seen_subcommand_from import" -l ca -d 'Certificates (PEM) of the authorities to trust instead of the system\'s [env: COVIS_CA]' -r -F
complete -c covis -n "__fish_covis_using_subcommand map; and __fish_seen_subcommand_from import" -l cert -d 'The client\'s own certificate (PEM), for mutual TLS [env: COVIS_CERT]' -r -F
complete -c covis -n "__fish_covis_using_subcommand map; and __fish_seen_subcommand_from import" -l key -d 'The private key of --cert (PEM) [env: COVIS_KEY]' -r -F
complete -c covis -n "__fish_covis_using_subcommand map; and __fish_seen_subcommand_from import" -l token-file -d 'File that holds the bearer token; COVIS_TOKEN holds the token itself [env: COVIS_TOKEN_FILE]' -r -F
complete -c covis -n "__fish_covis_using_subcommand map; and __fish_seen_subcommand_from import" -l server-wait -d 'Seconds to wait for a server that does not answer yet or still opens its maps; 0 fails at once [default: 10] [env: COVIS_SERVER_WAIT]' -r
complete -c covis -n "__fish_covis_using_subcommand map; and __fish_seen_subcommand_from import" -l config -d 'Configuration file instead of ./covis.toml [env: COVIS_CONFIG]' -r -F
complete -c covis -n "__fish_covis_using_subcommand map; and __fish_seen_subcommand_from import" -l log -d 'Log level (off, error, warn, info, debug, trace) or a list of them, `target=level` [default: info; warn of commands that do not write to a terminal] [env: COVIS_LOG]' -r
complete -c covis -n "__fish_covis_using_subcommand map; and __fish_seen_subcommand_from import" -l log-format -d 'Format of log lines [default: text] [env: COVIS_LOG_FORMAT]' -r -f -a "text\t'For people'
json\t'One JSON object a line'"
complete -c covis -n "__fish_covis_using_subcommand map; and __fish_seen_subcommand_from import" -l skip-unknown -d 'Skip the lines of a g2o file that covis does not read, and say how many of each tag. Without this flag such a line is an error'
complete -c covis -n "__fish_covis_using_subcommand map; and __fish_seen_subcommand_from import" -l json -d 'Print JSON instead of text'
complete -c covis -n "__fish_covis_using_subcommand map; and __fish_seen_subcommand_from import" -s h -l help -d 'Print help (see more with \'--help\')'
complete -c covis -n "__fish_covis_using_subcommand map; and __fish_seen_subcommand_from help" -f -a "list" -d 'List all maps'
complete -c covis -n "__fish_covis_using_subcommand map; and __fish_seen_subcommand_from help" -f -a "show" -d 'Show one map: counts, clients, bounds'
complete -c covis -n "__fish_covis_using_subcommand map; and __fish_seen_subcommand_from help" -f -a "create" -d 'Create an empty map'
complete -c covis -n "__fish_covis_using_subcommand map; and __fish_seen_subcommand_from help" -f -a "set" -d 'Change the policy of a map, and print it'
complete -c covis -n "__fish_covis_using_subcommand map; and __fish_seen_subcommand_from help" -f -a "rename" -d 'Change the display name of a map. Its id never changes'
complete -c covis -n "__fish_covis_using_subcommand map; and __fish_seen_subcommand_from help" -f -a "closures" -d 'List where keyframes looked like earlier ones: the loop closures that the server added, and why others were refused'
complete -c covis -n "__fish_covis_using_subcommand map; and __fish_seen_subcommand_from help" -f -a "constraints" -d 'List the constraints of a map, and which of them are switched off'
complete -c covis -n "__fish_covis_using_subcommand map; and __fish_seen_subcommand_from help" -f -a "freeze" -d 'Freeze a map: it can be read but not changed until you unfreeze it'
complete -c covis -n "__fish_covis_using_subcommand map; and __fish_seen_subcommand_from help" -f -a "unfreeze" -d 'Unfreeze a map, so that it can be changed again'
complete -c covis -n "__fish_covis_using_subcommand map; and __fish_seen_subcommand_from help" -f -a "edit" -d 'Change or remove content of a map'
complete -c covis -n "__fish_covis_using_subcommand map; and __fish_seen_subcommand_from help" -f -a "merge" -d 'Merge a map into another one that shows the same places'
complete -c covis -n "__fish_covis_using_subcommand map; and __fish_seen_subcommand_from help" -f -a "unmerge" -d 'Take a map out of the one that it was merged into'
complete -c covis -n "__fish_covis_using_subcommand map; and __fish_seen_subcommand_from help" -f -a "snapshot" -d 'Copy a map as it is now into a new, frozen map'
complete -c covis -n "__fish_covis_using_subcommand map; and __fish_seen_subcommand_from help" -f -a "restore" -d 'Restore an earlier state of a map from its journal, into a new map'
complete -c covis -n "__fish_covis_using_subcommand map; and __fish_seen_subcommand_from help" -f -a "delete" -d 'Delete a map with its journal'
complete -c covis -n "__fish_covis_using_subcommand map; and __fish_seen_subcommand_from help" -f -a "export" -d 'Write a map to files'
complete -c covis -n "__fish_covis_using_subcommand map; and __fish_seen_subcommand_from help" -f -a "import" -d 'Create a map from files: an export of covis, COLMAP, g2o, or a trajectory'
complete -c covis -n "__fish_covis_using_subcommand map; and __fish_seen_subcommand_from help" -f -a "help" -d 'Print this message or the help of the given subcommand(s)'
complete -c covis -n "__fish_covis_using_subcommand record" -l for -d 'Keep recording changes for this long' -r
complete -c covis -n "__fish_covis_using_subcommand record" -l every -d 'While the map changes, write landmarks, trajectories and closures at most this often' -r
complete -c covis -n "__fish_covis_using_subcommand record" -l server -d 'The server\'s URL [default: http://127.0.0.1:7411] [env: COVIS_SERVER]' -r
complete -c covis -n "__fish_covis_using_subcommand record" -l ca -d 'Certificates (PEM) of the authorities to trust instead of the system\'s [env: COVIS_CA]' -r -F
complete -c covis -n "__fish_covis_using_subcommand record" -l cert -d 'The client\'s own certificate (PEM), for mutual TLS [env: COVIS_CERT]' -r -F
complete -c covis -n "__fish_covis_using_subcommand record" -l key -d 'The private key of --cert (PEM) [env: COVIS_KEY]' -r -F
complete -c covis -n "__fish_covis_using_subcommand record" -l token-file -d 'File that holds the bearer token; COVIS_TOKEN holds the token itself [env: COVIS_TOKEN_FILE]' -r -F
complete -c covis -n "__fish_covis_using_subcommand record" -l server-wait -d 'Seconds to wait for a server that does not answer yet or still opens its maps; 0 fails at once [default: 10] [env: COVIS_SERVER_WAIT]' -r
complete -c covis -n "__fish_covis_using_subcommand record" -l config -d 'Configuration file instead of ./covis.toml [env: COVIS_CONFIG]' -r -F
complete -c covis -n "__fish_covis_using_subcommand record" -l log -d 'Log level (off, error, warn, info, debug, trace) or a list of them, `target=level` [default: info; warn of commands that do not write to a terminal] [env: COVIS_LOG]' -r
complete -c covis -n "__fish_covis_using_subcommand record" -l log-format -d 'Format of log lines [default: text] [env: COVIS_LOG_FORMAT]' -r -f -a "text\t'For people'
json\t'One JSON object a line'"
complete -c covis -n "__fish_covis_using_subcommand record" -l force -d 'Replace files that are there'
complete -c covis -n "__fish_covis_using_subcommand record" -l follow -d 'Keep recording changes until ctrl-c, SIGTERM or the end of the map'
complete -c covis -n "__fish_covis_using_subcommand record" -s h -l help -d 'Print help (see more with \'--help\')'
complete -c covis -n "__fish_covis_using_subcommand replay" -l map -d 'Name of the map; it is created if it does not exist [default: the file\'s name]' -r
complete -c covis -n "__fish_covis_using_subcommand replay" -l rate -d 'Send this many keyframes per second [default: as fast as the server takes them]' -r
complete -c covis -n "__fish_covis_using_subcommand replay" -l reconnect-for -d 'How long to retry when the server disconnects, before giving up; --server-wait is for the start' -r
complete -c covis -n "__fish_covis_using_subcommand replay" -l spill-dir -d 'While the server is unreachable, store unsent items that do not fit in memory in a file in this folder; the next run of the same recording onto the same map sends them first' -r -F
complete -c covis -n "__fish_covis_using_subcommand replay" -l spill-bytes -d 'Maximum size of that file, bytes [default: 1 GiB]' -r
complete -c covis -n "__fish_covis_using_subcommand replay" -l server -d 'The server\'s URL [default: http://127.0.0.1:7411] [env: COVIS_SERVER]' -r
complete -c covis -n "__fish_covis_using_subcommand replay" -l ca -d 'Certificates (PEM) of the authorities to trust instead of the system\'s [env: COVIS_CA]' -r -F
complete -c covis -n "__fish_covis_using_subcommand replay" -l cert -d 'The client\'s own certificate (PEM), for mutual TLS [env: COVIS_CERT]' -r -F
complete -c covis -n "__fish_covis_using_subcommand replay" -l key -d 'The private key of --cert (PEM) [env: COVIS_KEY]' -r -F
complete -c covis -n "__fish_covis_using_subcommand replay" -l token-file -d 'File that holds the bearer token; COVIS_TOKEN holds the token itself [env: COVIS_TOKEN_FILE]' -r -F
complete -c covis -n "__fish_covis_using_subcommand replay" -l server-wait -d 'Seconds to wait for a server that does not answer yet or still opens its maps; 0 fails at once [default: 10] [env: COVIS_SERVER_WAIT]' -r
complete -c covis -n "__fish_covis_using_subcommand replay" -l config -d 'Configuration file instead of ./covis.toml [env: COVIS_CONFIG]' -r -F
complete -c covis -n "__fish_covis_using_subcommand replay" -l log -d 'Log level (off, error, warn, info, debug, trace) or a list of them, `target=level` [default: info; warn of commands that do not write to a terminal] [env: COVIS_LOG]' -r
complete -c covis -n "__fish_covis_using_subcommand replay" -l log-format -d 'Format of log lines [default: text] [env: COVIS_LOG_FORMAT]' -r -f -a "text\t'For people'
json\t'One JSON object a line'"
complete -c covis -n "__fish_covis_using_subcommand replay" -l append -d 'Add to a map that is not empty. The server recognizes a file that was sent before and adds nothing twice'
complete -c covis -n "__fish_covis_using_subcommand replay" -l replace -d 'Delete the map\'s content first'
complete -c covis -n "__fish_covis_using_subcommand replay" -l no-lock-step -d 'Run solves in parallel with the stream: faster, but results are no longer reproducible to the bit'
complete -c covis -n "__fish_covis_using_subcommand replay" -l json -d 'Print one JSON object instead of a table; also after a failure and on SIGTERM'
complete -c covis -n "__fish_covis_using_subcommand replay" -s h -l help -d 'Print help (see more with \'--help\')'
complete -c covis -n "__fish_covis_using_subcommand run" -l map -d 'The map to create on the server' -r
complete -c covis -n "__fish_covis_using_subcommand run" -l out -d 'Folder for trajectories and masks; it is created if it is missing' -r -F
complete -c covis -n "__fish_covis_using_subcommand run" -l format -d 'Format of the trajectories' -r -f -a "tum\t'TUM trajectory'
kitti\t'KITTI odometry poses'
euroc\t'EuRoC (ASL) ground truth'"
complete -c covis -n "__fish_covis_using_subcommand run" -l camera -d 'Intrinsics, px: a file, or fx,fy,cx,cy[,k1,k2,p1,p2,k3]' -r
complete -c covis -n "__fish_covis_using_subcommand run" -l depth-scale -d 'Units of the depth images per meter: 1000 for millimeters [default: 5000 for the TUM layout, 1000 for 7-Scenes, for captures and for 16-bit depth of ROS, 1 for its 32-bit depth]' -r
complete -c covis -n "__fish_covis_using_subcommand run" -l color-topic -d 'Topic of the color images of an MCAP file or a bag [default: found by type and name]' -r
complete -c covis -n "__fish_covis_using_subcommand run" -l depth-topic -d 'Topic of the depth images, registered to color [default: found by type and name]' -r
complete -c covis -n "__fish_covis_using_subcommand run" -l camera-info-topic -d 'Topic of the camera\'s intrinsics [default: camera_info beside the color images]' -r
complete -c covis -n "__fish_covis_using_subcommand run" -l odometry -d 'Topic of odometry in an MCAP file or a bag. The motion between keyframes goes to the server as a measurement, whose noise the server finds. Static transforms must join its frame with the camera\'s' -r
complete -c covis -n "__fish_covis_using_subcommand run" -l readout-ms -d 'Time from the first row\'s exposure to the last row\'s [default: from camera.txt, else a Kinect\'s 26.1; of an MCAP file or a bag 0]' -r
complete -c covis -n "__fish_covis_using_subcommand run" -l depth-late-ms -d 'How much later than their timestamps depth images are taken [default: from camera.txt, else -15; of an MCAP file or a bag 0]' -r
complete -c covis -n "__fish_covis_using_subcommand run" -l mask-dir -d 'Masks of known moving objects, one PNG file per frame: above 127 where something moves, named by the frame\'s timestamp' -r -F
complete -c covis -n "__fish_covis_using_subcommand run" -l voxel -d 'Edge length of a voxel, meters' -r
complete -c covis -n "__fish_covis_using_subcommand run" -l truncation-voxels -d 'Truncation distance, voxels' -r
complete -c covis -n "__fish_covis_using_subcommand run" -l memory-mb -d 'Maximum size of the volume in memory, megabytes; parts far from the camera move to a temporary file in OUT [default: no limit]' -r
complete -c covis -n "__fish_covis_using_subcommand run" -l mesh-every -d 'Integrate every Nth frame' -r
complete -c covis -n "__fish_covis_using_subcommand run" -l threads -d 'Threads; a single one decodes and tracks frames in turn [default: all processors]' -r
complete -c covis -n "__fish_covis_using_subcommand run" -l seed -d 'Seed of a synthetic scene' -r
complete -c covis -n "__fish_covis_using_subcommand run" -l frames -d 'Frames of a synthetic scene' -r
complete -c covis -n "__fish_covis_using_subcommand run" -l mcap -d 'Record the map, images of keyframes and figures to plot as MCAP, for Foxglove and Rerun' -r -F
complete -c covis -n "__fish_covis_using_subcommand run" -l report -d 'Where to write the report of the run, one HTML file without scripts [default: OUT/report.html; with --json none]' -r -F
complete -c covis -n "__fish_covis_using_subcommand run" -l ca -d 'Certificates (PEM) of the authorities to trust instead of the system\'s [env: COVIS_CA]' -r -F
complete -c covis -n "__fish_covis_using_subcommand run" -l cert -d 'The client\'s own certificate (PEM), for mutual TLS [env: COVIS_CERT]' -r -F
complete -c covis -n "__fish_covis_using_subcommand run" -l key -d 'The private key of --cert (PEM) [env: COVIS_KEY]' -r -F
complete -c covis -n "__fish_covis_using_subcommand run" -l token-file -d 'File that holds the bearer token; COVIS_TOKEN holds the token itself [env: COVIS_TOKEN_FILE]' -r -F
complete -c covis -n "__fish_covis_using_subcommand run" -l server-wait -d 'Seconds to wait for a server that does not answer yet or still opens its maps; 0 fails at once [default: 10] [env: COVIS_SERVER_WAIT]' -r
complete -c covis -n "__fish_covis_using_subcommand run" -l server -d 'The server\'s URL; this command ignores COVIS_SERVER and covis.toml here [default: a server in this process]' -r
complete -c covis -n "__fish_covis_using_subcommand run" -l config -d 'Configuration file instead of ./covis.toml [env: COVIS_CONFIG]' -r -F
complete -c covis -n "__fish_covis_using_subcommand run" -l log -d 'Log level (off, error, warn, info, debug, trace) or a list of them, `target=level` [default: info; warn of commands that do not write to a terminal] [env: COVIS_LOG]' -r
complete -c covis -n "__fish_covis_using_subcommand run" -l log-format -d 'Format of log lines [default: text] [env: COVIS_LOG_FORMAT]' -r -f -a "text\t'For people'
json\t'One JSON object a line'"
complete -c covis -n "__fish_covis_using_subcommand run" -l force -d 'Replace files that are there'
complete -c covis -n "__fish_covis_using_subcommand run" -l no-mask -d 'Do not detect moving objects'
complete -c covis -n "__fish_covis_using_subcommand run" -l save-masks -d 'Write the masks of moving objects to OUT/masks'
complete -c covis -n "__fish_covis_using_subcommand run" -l mesh -d 'Build a dense map: write mesh.ply, mesh.glb and volume.covis to OUT'
complete -c covis -n "__fish_covis_using_subcommand run" -l lock-step -d 'Wait at each keyframe until the server has solved it: slower, but each run gives the same files, except for the times in its report. Without this flag tracking never waits for the server'
complete -c covis -n "__fish_covis_using_subcommand run" -l json -d 'Print one JSON object instead of a table'
complete -c covis -n "__fish_covis_using_subcommand run" -s h -l help -d 'Print help (see more with \'--help\')'
complete -c covis -n "__fish_covis_using_subcommand serve" -l listen -d 'Address to listen on, host:port; port 0 picks a free port [default: 127.0.0.1:7411] [env: COVIS_LISTEN]' -r
complete -c covis -n "__fish_covis_using_subcommand serve" -l tls-cert -d 'The server\'s certificate (PEM); with it, the server uses TLS [env: COVIS_TLS_CERT]' -r -F
complete -c covis -n "__fish_covis_using_subcommand serve" -l tls-key -d 'The private key of --tls-cert (PEM) [env: COVIS_TLS_KEY]' -r -F
complete -c covis -n "__fish_covis_using_subcommand serve" -l tls-client-ca -d 'Accept only clients whose certificate one of these authorities (PEM) has signed [env: COVIS_TLS_CLIENT_CA]' -r -F
complete -c covis -n "__fish_covis_using_subcommand serve" -l tokens -d 'Accept only calls with a bearer token that this file (TOML) lists [env: COVIS_TOKENS]' -r -F
complete -c covis -n "__fish_covis_using_subcommand serve" -l jwks -d 'Also accept JSON Web Tokens that a key of this set (JWKS) has signed [env: COVIS_JWKS]' -r -F
complete -c covis -n "__fish_covis_using_subcommand serve" -l jwt-issuer -d 'The issuer (`iss`) that those tokens must name [env: COVIS_JWT_ISSUER]' -r
complete -c covis -n "__fish_covis_using_subcommand serve" -l jwt-audience -d 'The audience (`aud`) that those tokens must name [env: COVIS_JWT_AUDIENCE]' -r
complete -c covis -n "__fish_covis_using_subcommand serve" -l metrics-listen -d 'Address at which the server answers `GET /metrics` for Prometheus, in plain text; port 0 picks a free port [default: none] [env: COVIS_METRICS_LISTEN]' -r
complete -c covis -n "__fish_covis_using_subcommand serve" -l http -d 'Address of the web page that shows maps; port 0 picks a free port [default: none] [env: COVIS_HTTP]' -r
complete -c covis -n "__fish_covis_using_subcommand serve" -l drain-budget -d 'Seconds that the server waits for running calls when it shuts down [default: 10] [env: COVIS_DRAIN_BUDGET]' -r
complete -c covis -n "__fish_covis_using_subcommand serve" -l job-retention -d 'Seconds for which the server keeps a job after its end [default: 604800] [env: COVIS_JOB_RETENTION]' -r
complete -c covis -n "__fish_covis_using_subcommand serve" -l otlp-endpoint -d 'Export spans of calls, items and solves to this collector by OTLP over gRPC, in builds with the feature `opentelemetry` [default: none] [env: COVIS_OTLP_ENDPOINT]' -r
complete -c covis -n "__fish_covis_using_subcommand serve" -l threads -d 'Worker threads for solves; results do not depend on their number [default: one per processor] [env: COVIS_THREADS]' -r
complete -c covis -n "__fish_covis_using_subcommand serve" -l data-dir -d 'Folder to keep maps in [default: the platform\'s folder for data] [env: COVIS_DATA_DIR]' -r -F
complete -c covis -n "__fish_covis_using_subcommand serve" -l nats -d 'Share maps with other servers over these NATS servers, URLs separated by commas, in builds with the feature `cluster` [default: none] [env: COVIS_NATS]' -r
complete -c covis -n "__fish_covis_using_subcommand serve" -l nats-monitoring -d 'Monitoring addresses of all NATS servers, separated by commas (http://host:8222): the server asks them whether NATS syncs before it acknowledges [default: none] [env: COVIS_NATS_MONITORING]' -r
complete -c covis -n "__fish_covis_using_subcommand serve" -l nats-replicas -d 'Number of NATS servers that keep each map\'s journal: 1, 3 or 5 [default: 3] [env: COVIS_NATS_REPLICAS]' -r
complete -c covis -n "__fish_covis_using_subcommand serve" -l lease-seconds -d 'Seconds of silence after which other servers take over a server\'s maps [default: 5] [env: COVIS_LEASE_SECONDS]' -r
complete -c covis -n "__fish_covis_using_subcommand serve" -l advertise -d 'URL of this server for clients that called another server of the cluster [default: from --listen] [env: COVIS_ADVERTISE]' -r
complete -c covis -n "__fish_covis_using_subcommand serve" -l max-message-bytes -d 'Largest message in bytes, in and out [default: 4194304] [env: COVIS_MAX_MESSAGE_BYTES]' -r
complete -c covis -n "__fish_covis_using_subcommand serve" -l max-concurrent-streams -d 'Maximum number of concurrent streams of one connection [default: 64] [env: COVIS_MAX_CONCURRENT_STREAMS]' -r
complete -c covis -n "__fish_covis_using_subcommand serve" -l max-connections -d 'Maximum number of connections [default: 512] [env: COVIS_MAX_CONNECTIONS]' -r
complete -c covis -n "__fish_covis_using_subcommand serve" -l max-strangers -d 'Maximum number of connections that have not made an admitted call yet; at most half of max-connections [default: 256] [env: COVIS_MAX_STRANGERS]' -r
complete -c covis -n "__fish_covis_using_subcommand serve" -l queue-capacity -d 'Items that may wait for a map\'s engine before a stream is slowed down [default: 64] [env: COVIS_QUEUE_CAPACITY]' -r
complete -c covis -n "__fish_covis_using_subcommand serve" -l config -d 'Configuration file instead of ./covis.toml [env: COVIS_CONFIG]' -r -F
complete -c covis -n "__fish_covis_using_subcommand serve" -l log -d 'Log level (off, error, warn, info, debug, trace) or a list of them, `target=level` [default: info; warn of commands that do not write to a terminal] [env: COVIS_LOG]' -r
complete -c covis -n "__fish_covis_using_subcommand serve" -l log-format -d 'Format of log lines [default: text] [env: COVIS_LOG_FORMAT]' -r -f -a "text\t'For people'
json\t'One JSON object a line'"
complete -c covis -n "__fish_covis_using_subcommand serve" -l insecure-plain-text -d 'Serve plain text beyond loopback too: others on the network can read and change everything [env: COVIS_INSECURE_PLAIN_TEXT]'
complete -c covis -n "__fish_covis_using_subcommand serve" -l lock-step -d 'Finish each solve before taking the next item of a stream [env: COVIS_LOCK_STEP]'
complete -c covis -n "__fish_covis_using_subcommand serve" -l in-memory -d 'Keep maps in memory only: they are lost when the server stops [env: COVIS_IN_MEMORY]'
complete -c covis -n "__fish_covis_using_subcommand serve" -l accept-unsynced-replicas -d 'Accept NATS servers that acknowledge before they sync: if several of them lose power, acknowledged items are lost [env: COVIS_ACCEPT_UNSYNCED_REPLICAS]'
complete -c covis -n "__fish_covis_using_subcommand serve" -s h -l help -d 'Print help (see more with \'--help\')'
complete -c covis -n "__fish_covis_using_subcommand worker" -l threads -d 'Worker threads for solves; results do not depend on their number [default: one per processor] [env: COVIS_THREADS]' -r
complete -c covis -n "__fish_covis_using_subcommand worker" -l nats -d 'Share maps with other servers over these NATS servers, URLs separated by commas, in builds with the feature `cluster` [default: none] [env: COVIS_NATS]' -r
complete -c covis -n "__fish_covis_using_subcommand worker" -l nats-monitoring -d 'Monitoring addresses of all NATS servers, separated by commas (http://host:8222): the server asks them whether NATS syncs before it acknowledges [default: none] [env: COVIS_NATS_MONITORING]' -r
complete -c covis -n "__fish_covis_using_subcommand worker" -l nats-replicas -d 'Number of NATS servers that keep each map\'s journal: 1, 3 or 5 [default: 3] [env: COVIS_NATS_REPLICAS]' -r
complete -c covis -n "__fish_covis_using_subcommand worker" -l lease-seconds -d 'Seconds of silence after which other servers take over a server\'s maps [default: 5] [env: COVIS_LEASE_SECONDS]' -r
complete -c covis -n "__fish_covis_using_subcommand worker" -l config -d 'Configuration file instead of ./covis.toml [env: COVIS_CONFIG]' -r -F
complete -c covis -n "__fish_covis_using_subcommand worker" -l log -d 'Log level (off, error, warn, info, debug, trace) or a list of them, `target=level` [default: info; warn of commands that do not write to a terminal] [env: COVIS_LOG]' -r
complete -c covis -n "__fish_covis_using_subcommand worker" -l log-format -d 'Format of log lines [default: text] [env: COVIS_LOG_FORMAT]' -r -f -a "text\t'For people'
json\t'One JSON object a line'"
complete -c covis -n "__fish_covis_using_subcommand worker" -l accept-unsynced-replicas -d 'Accept NATS servers that acknowledge before they sync: if several of them lose power, acknowledged items are lost [env: COVIS_ACCEPT_UNSYNCED_REPLICAS]'
complete -c covis -n "__fish_covis_using_subcommand worker" -s h -l help -d 'Print help (see more with \'--help\')'
complete -c covis -n "__fish_covis_using_subcommand solve; and not __fish_seen_subcommand_from bundle pose-graph help" -l threads -d 'Worker threads for solves; results do not depend on their number [default: one per processor] [env: COVIS_THREADS]' -r
complete -c covis -n "__fish_covis_using_subcommand solve; and not __fish_seen_subcommand_from bundle pose-graph help" -l config -d 'Configuration file instead of ./covis.toml [env: COVIS_CONFIG]' -r -F
complete -c covis -n "__fish_covis_using_subcommand solve; and not __fish_seen_subcommand_from bundle pose-graph help" -l log -d 'Log level (off, error, warn, info, debug, trace) or a list of them, `target=level` [default: info; warn of commands that do not write to a terminal] [env: COVIS_LOG]' -r
complete -c covis -n "__fish_covis_using_subcommand solve; and not __fish_seen_subcommand_from bundle pose-graph help" -l log-format -d 'Format of log lines [default: text] [env: COVIS_LOG_FORMAT]' -r -f -a "text\t'For people'
json\t'One JSON object a line'"
complete -c covis -n "__fish_covis_using_subcommand solve; and not __fish_seen_subcommand_from bundle pose-graph help" -s h -l help -d 'Print help (see more with \'--help\')'
complete -c covis -n "__fish_covis_using_subcommand solve; and not __fish_seen_subcommand_from bundle pose-graph help" -f -a "bundle" -d 'Bundle adjustment of a file of BAL, Bundler or OpenMVG, or of a folder with a COLMAP sparse model'
complete -c covis -n "__fish_covis_using_subcommand solve; and not __fish_seen_subcommand_from bundle pose-graph help" -f -a "pose-graph" -d 'A g2o or pyfg pose graph, SE2 or SE3; its first vertex (of g2o the lowest id) is held fixed'
complete -c covis -n "__fish_covis_using_subcommand solve; and not __fish_seen_subcommand_from bundle pose-graph help" -f -a "help" -d 'Print this message or the help of the given subcommand(s)'
complete -c covis -n "__fish_covis_using_subcommand solve; and __fish_seen_subcommand_from bundle" -l max-iterations -d 'Maximum number of iterations, rejected ones included' -r
complete -c covis -n "__fish_covis_using_subcommand solve; and __fish_seen_subcommand_from bundle" -l loss -d 'Robust loss of every factor: trivial, huber:W or cauchy:W, W in standard deviations' -r
complete -c covis -n "__fish_covis_using_subcommand solve; and __fish_seen_subcommand_from bundle" -l out -d 'Write the solved problem in the input\'s own format, with 17 digits; that of OpenMVG as a folder with a COLMAP sparse model' -r -F
complete -c covis -n "__fish_covis_using_subcommand solve; and __fish_seen_subcommand_from bundle" -l report -d 'Write a report with plots and tables: one HTML file without scripts, for a browser' -r -F
complete -c covis -n "__fish_covis_using_subcommand solve; and __fish_seen_subcommand_from bundle" -l free-intrinsics -d 'Intrinsics to optimize, where the camera\'s model has them: a list with commas' -r -f -a "focal-length\t'One or two focal lengths, depending on the model'
principal-point\t'The principal point'
distortion\t'The coefficients of the distortion'"
complete -c covis -n "__fish_covis_using_subcommand solve; and __fish_seen_subcommand_from bundle" -l linear-solver -d 'How the reduced camera system is stored and factored' -r -f -a "auto\t'The cheapest by its cost, which may change during a solve'
dense-schur\t'A dense factorization'
sparse-schur\t'A sparse factorization'
iterative-schur\t'Conjugate gradients, without a factorization'"
complete -c covis -n "__fish_covis_using_subcommand solve; and __fish_seen_subcommand_from bundle" -l behind-camera -d 'What to do with observations whose landmark starts at or behind the camera\'s center plane' -r -f -a "count\t'Use them like all others'
drop\t'Leave them out of the solve; the written file keeps them'"
complete -c covis -n "__fish_covis_using_subcommand solve; and __fish_seen_subcommand_from bundle" -l threads -d 'Worker threads for solves; results do not depend on their number [default: one per processor] [env: COVIS_THREADS]' -r
complete -c covis -n "__fish_covis_using_subcommand solve; and __fish_seen_subcommand_from bundle" -l config -d 'Configuration file instead of ./covis.toml [env: COVIS_CONFIG]' -r -F
complete -c covis -n "__fish_covis_using_subcommand solve; and __fish_seen_subcommand_from bundle" -l log -d 'Log level (off, error, warn, info, debug, trace) or a list of them, `target=level` [default: info; warn of commands that do not write to a terminal] [env: COVIS_LOG]' -r
complete -c covis -n "__fish_covis_using_subcommand solve; and __fish_seen_subcommand_from bundle" -l log-format -d 'Format of log lines [default: text] [env: COVIS_LOG_FORMAT]' -r -f -a "text\t'For people'
json\t'One JSON object a line'"
complete -c covis -n "__fish_covis_using_subcommand solve; and __fish_seen_subcommand_from bundle" -l json -d 'Print one JSON object instead of a table'
complete -c covis -n "__fish_covis_using_subcommand solve; and __fish_seen_subcommand_from bundle" -l force -d 'Replace files that are there'
complete -c covis -n "__fish_covis_using_subcommand solve; and __fish_seen_subcommand_from bundle" -l fix-intrinsics -d 'Hold focal lengths, distortion and principal points fixed'
complete -c covis -n "__fish_covis_using_subcommand solve; and __fish_seen_subcommand_from bundle" -l rebuild -d 'Discard the file\'s poses and points and reconstruct them from its observations first; the solve leaves out observations that do not agree with the reconstruction'
complete -c covis -n "__fish_covis_using_subcommand solve; and __fish_seen_subcommand_from bundle" -s h -l help -d 'Print help (see more with \'--help\')'
complete -c covis -n "__fish_covis_using_subcommand solve; and __fish_seen_subcommand_from pose-graph" -l max-iterations -d 'Maximum number of iterations, rejected ones included' -r
complete -c covis -n "__fish_covis_using_subcommand solve; and __fish_seen_subcommand_from pose-graph" -l loss -d 'Robust loss of every factor: trivial, huber:W or cauchy:W, W in standard deviations' -r
complete -c covis -n "__fish_covis_using_subcommand solve; and __fish_seen_subcommand_from pose-graph" -l out -d 'Write the solved problem in the input\'s own format, with 17 digits; that of OpenMVG as a folder with a COLMAP sparse model' -r -F
complete -c covis -n "__fish_covis_using_subcommand solve; and __fish_seen_subcommand_from pose-graph" -l report -d 'Write a report with plots and tables: one HTML file without scripts, for a browser' -r -F
complete -c covis -n "__fish_covis_using_subcommand solve; and __fish_seen_subcommand_from pose-graph" -l method -d 'Levenberg-Marquardt or Gauss-Newton' -r -f -a "lm\t'Levenberg-Marquardt'
gn\t'Gauss-Newton'"
complete -c covis -n "__fish_covis_using_subcommand solve; and __fish_seen_subcommand_from pose-graph" -l init -d 'Initial poses of the solve' -r -f -a "given\t'The vertices of the file'
odometry\t'Measurements between consecutive ids, chained; closures only where such a chain ends'
spanning-tree\t'Measurements chained along a spanning tree, as few as possible to each vertex'
chordal\t'Relaxed rotations, then positions'
auto\t'The vertices of the file or the chordal start, whichever has the lower cost'"
complete -c covis -n "__fish_covis_using_subcommand solve; and __fish_seen_subcommand_from pose-graph" -l robust -d 'Find false loop closures (edges between ids that are not consecutive) and leave them out: graduated non-convexity to truncated least squares or to Geman-McClure' -r -f -a "none\t'Trust all closures'
gnc-tls\t'Truncated least squares'
gnc-gm\t'Geman-McClure'"
complete -c covis -n "__fish_covis_using_subcommand solve; and __fish_seen_subcommand_from pose-graph" -l robust-threshold -d 'Largest χ² of a true closure [default: the 99 % quantile, 11.3 in SE2 and 16.8 in SE3]' -r
complete -c covis -n "__fish_covis_using_subcommand solve; and __fish_seen_subcommand_from pose-graph" -l trusted -d 'A loop closure that `--robust` must trust, by the ids or names of its two vertices; may be repeated' -r
complete -c covis -n "__fish_covis_using_subcommand solve; and __fish_seen_subcommand_from pose-graph" -l threads -d 'Worker threads for solves; results do not depend on their number [default: one per processor] [env: COVIS_THREADS]' -r
complete -c covis -n "__fish_covis_using_subcommand solve; and __fish_seen_subcommand_from pose-graph" -l config -d 'Configuration file instead of ./covis.toml [env: COVIS_CONFIG]' -r -F
complete -c covis -n "__fish_covis_using_subcommand solve; and __fish_seen_subcommand_from pose-graph" -l log -d 'Log level (off, error, warn, info, debug, trace) or a list of them, `target=level` [default: info; warn of commands that do not write to a terminal] [env: COVIS_LOG]' -r
complete -c covis -n "__fish_covis_using_subcommand solve; and __fish_seen_subcommand_from pose-graph" -l log-format -d 'Format of log lines [default: text] [env: COVIS_LOG_FORMAT]' -r -f -a "text\t'For people'
json\t'One JSON object a line'"
complete -c covis -n "__fish_covis_using_subcommand solve; and __fish_seen_subcommand_from pose-graph" -l json -d 'Print one JSON object instead of a table'
complete -c covis -n "__fish_covis_using_subcommand solve; and __fish_seen_subcommand_from pose-graph" -l force -d 'Replace files that are there'
complete -c covis -n "__fish_covis_using_subcommand solve; and __fish_seen_subcommand_from pose-graph" -l certify -d 'Start from the optimum of SE-Sync\'s chordal objective (no loss, isotropic weights) and prove that it is the global one. The proof does not cover the cost that the solve then reaches'
complete -c covis -n "__fish_covis_using_subcommand solve; and __fish_seen_subcommand_from pose-graph" -l repair-information -d 'Replace each information matrix that has negative eigenvalues by the nearest positive semi-definite matrix; --out writes the replacements. Without this flag such a matrix is an error'
complete -c covis -n "__fish_covis_using_subcommand solve; and __fish_seen_subcommand_from pose-graph" -l skip-unknown -d 'Skip the lines that covis does not read, and say how many of each tag; --out does not have them. Without this flag such a line is an error'
complete -c covis -n "__fish_covis_using_subcommand solve; and __fish_seen_subcommand_from pose-graph" -l incremental -d 'Add the vertices one by one in id order, each with its edges to lower ids, and optimize after each; reports how long a step takes'
complete -c covis -n "__fish_covis_using_subcommand solve; and __fish_seen_subcommand_from pose-graph" -s h -l help -d 'Print help (see more with \'--help\')'
complete -c covis -n "__fish_covis_using_subcommand solve; and __fish_seen_subcommand_from help" -f -a "bundle" -d 'Bundle adjustment of a file of BAL, Bundler or OpenMVG, or of a folder with a COLMAP sparse model'
complete -c covis -n "__fish_covis_using_subcommand solve; and __fish_seen_subcommand_from help" -f -a "pose-graph" -d 'A g2o or pyfg pose graph, SE2 or SE3; its first vertex (of g2o the lowest id) is held fixed'
complete -c covis -n "__fish_covis_using_subcommand solve; and __fish_seen_subcommand_from help" -f -a "help" -d 'Print this message or the help of the given subcommand(s)'
complete -c covis -n "__fish_covis_using_subcommand help; and not __fish_seen_subcommand_from doctor backup convert eval fuse mesh grid bench-frontend demo synth completions health job load map record replay run serve worker solve help" -f -a "doctor" -d 'Check a data directory without a server: verify, report, repair'
complete -c covis -n "__fish_covis_using_subcommand help; and not __fish_seen_subcommand_from doctor backup convert eval fuse mesh grid bench-frontend demo synth completions health job load map record replay run serve worker solve help" -f -a "backup" -d 'Copy a data directory, even while a server uses it'
complete -c covis -n "__fish_covis_using_subcommand help; and not __fish_seen_subcommand_from doctor backup convert eval fuse mesh grid bench-frontend demo synth completions health job load map record replay run serve worker solve help" -f -a "convert" -d 'Write a file in another format: trajectories, bundle adjustment, pose graphs'
complete -c covis -n "__fish_covis_using_subcommand help; and not __fish_seen_subcommand_from doctor backup convert eval fuse mesh grid bench-frontend demo synth completions health job load map record replay run serve worker solve help" -f -a "eval" -d 'Compare trajectories: absolute (APE) or relative pose error (RPE)'
complete -c covis -n "__fish_covis_using_subcommand help; and not __fish_seen_subcommand_from doctor backup convert eval fuse mesh grid bench-frontend demo synth completions health job load map record replay run serve worker solve help" -f -a "fuse" -d 'Fuse recorded depth and color images into a surface, at given poses'
complete -c covis -n "__fish_covis_using_subcommand help; and not __fish_seen_subcommand_from doctor backup convert eval fuse mesh grid bench-frontend demo synth completions health job load map record replay run serve worker solve help" -f -a "mesh" -d 'Write the surface of a stored volume as PLY or GLB'
complete -c covis -n "__fish_covis_using_subcommand help; and not __fish_seen_subcommand_from doctor backup convert eval fuse mesh grid bench-frontend demo synth completions health job load map record replay run serve worker solve help" -f -a "grid" -d 'Write a navigation grid from a stored volume: occupancy (PGM, YAML) or distances (PFM)'
complete -c covis -n "__fish_covis_using_subcommand help; and not __fish_seen_subcommand_from doctor backup convert eval fuse mesh grid bench-frontend demo synth completions health job load map record replay run serve worker solve help" -f -a "bench-frontend" -d 'Measure the reference frontend on sequences with ground truth, with and without the mask'
complete -c covis -n "__fish_covis_using_subcommand help; and not __fish_seen_subcommand_from doctor backup convert eval fuse mesh grid bench-frontend demo synth completions health job load map record replay run serve worker solve help" -f -a "demo" -d 'Track a camera in a synthetic room in which people walk, with and without the mask, on its own server'
complete -c covis -n "__fish_covis_using_subcommand help; and not __fish_seen_subcommand_from doctor backup convert eval fuse mesh grid bench-frontend demo synth completions health job load map record replay run serve worker solve help" -f -a "synth" -d 'Write synthetic data with ground truth'
complete -c covis -n "__fish_covis_using_subcommand help; and not __fish_seen_subcommand_from doctor backup convert eval fuse mesh grid bench-frontend demo synth completions health job load map record replay run serve worker solve help" -f -a "completions" -d 'Write the completions of a shell, for its startup file or its folder of completions'
complete -c covis -n "__fish_covis_using_subcommand help; and not __fish_seen_subcommand_from doctor backup convert eval fuse mesh grid bench-frontend demo synth completions health job load map record replay run serve worker solve help" -f -a "health" -d 'Check whether a server is ready; the exit code is 0 if it is'
complete -c covis -n "__fish_covis_using_subcommand help; and not __fish_seen_subcommand_from doctor backup convert eval fuse mesh grid bench-frontend demo synth completions health job load map record replay run serve worker solve help" -f -a "job" -d 'Submit, list, show, watch, cancel or delete the jobs of a server'
complete -c covis -n "__fish_covis_using_subcommand help; and not __fish_seen_subcommand_from doctor backup convert eval fuse mesh grid bench-frontend demo synth completions health job load map record replay run serve worker solve help" -f -a "load" -d 'Put a server under load: several maps, each with a client that sends keyframes at a fixed rate'
complete -c covis -n "__fish_covis_using_subcommand help; and not __fish_seen_subcommand_from doctor backup convert eval fuse mesh grid bench-frontend demo synth completions health job load map record replay run serve worker solve help" -f -a "map" -d 'List, show, create, change, copy, restore, export, import or delete the maps of a server'
complete -c covis -n "__fish_covis_using_subcommand help; and not __fish_seen_subcommand_from doctor backup convert eval fuse mesh grid bench-frontend demo synth completions health job load map record replay run serve worker solve help" -f -a "record" -d 'Record a map as MCAP, for Foxglove and Rerun'
complete -c covis -n "__fish_covis_using_subcommand help; and not __fish_seen_subcommand_from doctor backup convert eval fuse mesh grid bench-frontend demo synth completions health job load map record replay run serve worker solve help" -f -a "replay" -d 'Stream a BAL file or a COLMAP folder to a server, as a frontend would, then optimize the map'
complete -c covis -n "__fish_covis_using_subcommand help; and not __fish_seen_subcommand_from doctor backup convert eval fuse mesh grid bench-frontend demo synth completions health job load map record replay run serve worker solve help" -f -a "run" -d 'Track an RGB-D sequence with the reference frontend, through a server'
complete -c covis -n "__fish_covis_using_subcommand help; and not __fish_seen_subcommand_from doctor backup convert eval fuse mesh grid bench-frontend demo synth completions health job load map record replay run serve worker solve help" -f -a "serve" -d 'Serve maps over gRPC until SIGTERM or ctrl-c'
complete -c covis -n "__fish_covis_using_subcommand help; and not __fish_seen_subcommand_from doctor backup convert eval fuse mesh grid bench-frontend demo synth completions health job load map record replay run serve worker solve help" -f -a "worker" -d 'Solve problem files of servers\' jobs until SIGTERM or ctrl-c, in builds with the feature `cluster`'
complete -c covis -n "__fish_covis_using_subcommand help; and not __fish_seen_subcommand_from doctor backup convert eval fuse mesh grid bench-frontend demo synth completions health job load map record replay run serve worker solve help" -f -a "solve" -d 'Solve a file: bundle adjustment or pose graph. `covis solve FILE` sees which it is'
complete -c covis -n "__fish_covis_using_subcommand help; and not __fish_seen_subcommand_from doctor backup convert eval fuse mesh grid bench-frontend demo synth completions health job load map record replay run serve worker solve help" -f -a "help" -d 'Print this message or the help of the given subcommand(s)'
complete -c covis -n "__fish_covis_using_subcommand help; and __fish_seen_subcommand_from eval" -f -a "ape" -d 'Absolute pose error of aligned trajectories'
complete -c covis -n "__fish_covis_using_subcommand help; and __fish_seen_subcommand_from eval" -f -a "rpe" -d 'Relative pose error from one matched pose to the next, or over a number of poses, a path, an angle or a time'
complete -c covis -n "__fish_covis_using_subcommand help; and __fish_seen_subcommand_from eval" -f -a "mask" -d 'Intersection over union of masks of moving objects, and the share that they mask falsely'
complete -c covis -n "__fish_covis_using_subcommand help; and __fish_seen_subcommand_from eval" -f -a "truth" -d 'Write the ground-truth poses beside recorded images as a trajectory'
complete -c covis -n "__fish_covis_using_subcommand help; and __fish_seen_subcommand_from synth" -f -a "rgbd" -d 'An RGB-D sequence of an indoor scene: color, depth, ground truth of the camera, masks of moving objects'
complete -c covis -n "__fish_covis_using_subcommand help; and __fish_seen_subcommand_from job" -f -a "submit" -d 'Create a job on a map of the server, or on files that are sent to it'
complete -c covis -n "__fish_covis_using_subcommand help; and __fish_seen_subcommand_from job" -f -a "list" -d 'List the jobs, the newest first'
complete -c covis -n "__fish_covis_using_subcommand help; and __fish_seen_subcommand_from job" -f -a "show" -d 'Show a job with its report'
complete -c covis -n "__fish_covis_using_subcommand help; and __fish_seen_subcommand_from job" -f -a "watch" -d 'Follow a job to its end and print a line at each change'
complete -c covis -n "__fish_covis_using_subcommand help; and __fish_seen_subcommand_from job" -f -a "cancel" -d 'Ask a job to stop without applying its result'
complete -c covis -n "__fish_covis_using_subcommand help; and __fish_seen_subcommand_from job" -f -a "delete" -d 'Delete a job that has ended, with its files'
complete -c covis -n "__fish_covis_using_subcommand help; and __fish_seen_subcommand_from job" -f -a "fetch" -d 'Write the files that a job made: the report, solved problems, an export'
complete -c covis -n "__fish_covis_using_subcommand help; and __fish_seen_subcommand_from map" -f -a "list" -d 'List all maps'
complete -c covis -n "__fish_covis_using_subcommand help; and __fish_seen_subcommand_from map" -f -a "show" -d 'Show one map: counts, clients, bounds'
complete -c covis -n "__fish_covis_using_subcommand help; and __fish_seen_subcommand_from map" -f -a "create" -d 'Create an empty map'
complete -c covis -n "__fish_covis_using_subcommand help; and __fish_seen_subcommand_from map" -f -a "set" -d 'Change the policy of a map, and print it'
complete -c covis -n "__fish_covis_using_subcommand help; and __fish_seen_subcommand_from map" -f -a "rename" -d 'Change the display name of a map. Its id never changes'
complete -c covis -n "__fish_covis_using_subcommand help; and __fish_seen_subcommand_from map" -f -a "closures" -d 'List where keyframes looked like earlier ones: the loop closures that the server added, and why others were refused'
complete -c covis -n "__fish_covis_using_subcommand help; and __fish_seen_subcommand_from map" -f -a "constraints" -d 'List the constraints of a map, and which of them are switched off'
complete -c covis -n "__fish_covis_using_subcommand help; and __fish_seen_subcommand_from map" -f -a "freeze" -d 'Freeze a map: it can be read but not changed until you unfreeze it'
complete -c covis -n "__fish_covis_using_subcommand help; and __fish_seen_subcommand_from map" -f -a "unfreeze" -d 'Unfreeze a map, so that it can be changed again'
complete -c covis -n "__fish_covis_using_subcommand help; and __fish_seen_subcommand_from map" -f -a "edit" -d 'Change or remove content of a map'
complete -c covis -n "__fish_covis_using_subcommand help; and __fish_seen_subcommand_from map" -f -a "merge" -d 'Merge a map into another one that shows the same places'
complete -c covis -n "__fish_covis_using_subcommand help; and __fish_seen_subcommand_from map" -f -a "unmerge" -d 'Take a map out of the one that it was merged into'
complete -c covis -n "__fish_covis_using_subcommand help; and __fish_seen_subcommand_from map" -f -a "snapshot" -d 'Copy a map as it is now into a new, frozen map'
complete -c covis -n "__fish_covis_using_subcommand help; and __fish_seen_subcommand_from map" -f -a "restore" -d 'Restore an earlier state of a map from its journal, into a new map'
complete -c covis -n "__fish_covis_using_subcommand help; and __fish_seen_subcommand_from map" -f -a "delete" -d 'Delete a map with its journal'
complete -c covis -n "__fish_covis_using_subcommand help; and __fish_seen_subcommand_from map" -f -a "export" -d 'Write a map to files'
complete -c covis -n "__fish_covis_using_subcommand help; and __fish_seen_subcommand_from map" -f -a "import" -d 'Create a map from files: an export of covis, COLMAP, g2o, or a trajectory'
complete -c covis -n "__fish_covis_using_subcommand help; and __fish_seen_subcommand_from solve" -f -a "bundle" -d 'Bundle adjustment of a file of BAL, Bundler or OpenMVG, or of a folder with a COLMAP sparse model'
complete -c covis -n "__fish_covis_using_subcommand help; and __fish_seen_subcommand_from solve" -f -a "pose-graph" -d 'A g2o or pyfg pose graph, SE2 or SE3; its first vertex (of g2o the lowest id) is held fixed'
