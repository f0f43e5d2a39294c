//! Message definitions as rosbag2 writes them: each with everything it refers to, in its order and with its separators.

macro_rules! part {
    ($name:literal, $fields:literal) => {
        concat!(
            "================================================================================\nMSG: ",
            $name,
            "\n",
            $fields
        )
    };
}

macro_rules! header {
    () => {
        concat!(
            part!("std_msgs/Header", "builtin_interfaces/Time stamp\nstring frame_id\n"),
            part!("builtin_interfaces/Time", "int32 sec\nuint32 nanosec\n")
        )
    };
}

macro_rules! pose_with_covariance {
    () => {
        part!("geometry_msgs/PoseWithCovariance", "Pose pose\nfloat64[36] covariance\n")
    };
}

macro_rules! pose {
    () => {
        concat!(
            part!("geometry_msgs/Pose", "Point position\nQuaternion orientation\n"),
            part!("geometry_msgs/Point", "float64 x\nfloat64 y\nfloat64 z\n"),
            part!("geometry_msgs/Quaternion", "float64 x 0\nfloat64 y 0\nfloat64 z 0\nfloat64 w 1\n")
        )
    };
}

pub(super) const POSE_NAME: &str = "geometry_msgs/msg/PoseWithCovarianceStamped";
pub(super) const POSE: &str =
    concat!("std_msgs/Header header\nPoseWithCovariance pose\n", pose_with_covariance!(), pose!(), header!());

pub(super) const CLOUD_NAME: &str = "sensor_msgs/msg/PointCloud2";
pub(super) const CLOUD: &str = concat!(
    "std_msgs/Header header\nuint32 height\nuint32 width\nPointField[] fields\nbool is_bigendian\nuint32 point_step\n",
    "uint32 row_step\nuint8[] data\nbool is_dense\n",
    part!(
        "sensor_msgs/PointField",
        "uint8 INT8=1\nuint8 UINT8=2\nuint8 INT16=3\nuint8 UINT16=4\nuint8 INT32=5\nuint8 UINT32=6\nuint8 FLOAT32=7\nuint8 FLOAT64=8\nstring name\nuint32 offset\nuint8 datatype\nuint32 count\n"
    ),
    header!()
);

pub(super) const ODOMETRY_NAME: &str = "nav_msgs/msg/Odometry";
pub(super) const ODOMETRY: &str = concat!(
    "std_msgs/Header header\nstring child_frame_id\ngeometry_msgs/PoseWithCovariance pose\n",
    "geometry_msgs/TwistWithCovariance twist\n",
    pose_with_covariance!(),
    part!("geometry_msgs/TwistWithCovariance", "Twist twist\nfloat64[36] covariance\n"),
    part!("geometry_msgs/Twist", "Vector3 linear\nVector3 angular\n"),
    part!("geometry_msgs/Vector3", "float64 x\nfloat64 y\nfloat64 z\n"),
    pose!(),
    header!()
);
