/* Find a robot in a prior map, from LiDAR alone. Link with libesm.a (and -lpthread -ldl -lm) or libesm.so.
 *
 * Made by cbindgen out of crates/esm-c/src; a test holds it there. Points are f32 metres, poses f64 and named by their frames:
 * pose_map_sensor takes sensor coordinates to map coordinates. Frames have z up. A handle belongs to one thread at a time; several
 * robots may share a map. Nothing here prints, and nothing ends the program. */

#ifndef ESM_H
#define ESM_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

/*
 Whether a call did what it was asked for; where it did not, `esm_last_error` tells why.
 */
typedef enum EsmStatus {
  /*
   Done.
   */
  ESM_STATUS_OK = 0,
  /*
   Not done.
   */
  ESM_STATUS_FAILED = 1,
} EsmStatus;

/*
 What is said about a cloud.
 */
typedef enum EsmVerdict {
  /*
   The pose is trusted.
   */
  ESM_VERDICT_LOCATED = 0,
  /*
   Two places explain the cloud nearly as well: the pose is a guess.
   */
  ESM_VERDICT_AMBIGUOUS = 1,
  /*
   No place explains the cloud well enough: there is no pose.
   */
  ESM_VERDICT_NOT_FOUND = 2,
  /*
   The sweep was taken, a cloud is not complete yet (with `accumulate.swathes`).
   */
  ESM_VERDICT_NO_CLOUD = 3,
} EsmVerdict;

/*
 A prior map.
 */
typedef struct EsmMap EsmMap;

/*
 A robot in a map: it keeps the last metres of travel, and what it believes of its place.
 */
typedef struct EsmRobot EsmRobot;

/*
 A pose: position in metres, orientation as a unit quaternion in the order of ROS.
 */
typedef struct EsmPose {
  /*
   x, y, z in metres.
   */
  double position[3];
  /*
   x, y, z, w.
   */
  double orientation[4];
} EsmPose;

/*
 The answer to one sweep.
 */
typedef struct EsmAnswer {
  /*
   Seconds, of the sweep.
   */
  double stamp;
  /*
   Whether the pose is to be trusted.
   */
  enum EsmVerdict verdict;
  /*
   Whether `pose_map_sensor` and `covariance` hold something: with `located` and `ambiguous`.
   */
  bool has_pose;
  /*
   Pose of the sensor in the map.
   */
  struct EsmPose pose_map_sensor;
  /*
   Row-major 6 x 6, order x y z rx ry rz in m and rad: of a right perturbation in the sensor frame.
   */
  double covariance[36];
  /*
   Metres of travel the cloud holds.
   */
  double travel_m;
  /*
   Segments cut from the cloud.
   */
  uint32_t segments;
  /*
   Matched segments that agree with the pose.
   */
  uint32_t inliers;
  /*
   Share of the points above the ground, where the map has been seen, that lie on what stands there in the map.
   */
  double overlap;
  /*
   How well the best place explains the cloud.
   */
  double score;
  /*
   The same of the best other place, 0 where there is none.
   */
  double runner_up;
  /*
   Seconds spent.
   */
  double seconds;
  /*
   Points of the sweep that were not finite and were dropped.
   */
  uint64_t dropped_points;
} EsmAnswer;

#ifdef __cplusplus
extern "C" {
#endif // __cplusplus

/*
 The version of this library, such as `0.1.0`.
 */
const char *esm_version(void);

/*
 Why the last call on this thread failed: what, where and a hint. Valid until the next call on this thread.
 */
const char *esm_last_error(void);

/*
 Has all work done on the thread that calls; else there is one thread a core. Call it once, before anything else, on the thread
 that will push sweeps. The answers are the same bits either way.
 */
enum EsmStatus esm_use_one_thread(void);

/*
 Opens a map file. NULL where it cannot be opened.

 # Safety
 `file` is a string that ends with a NUL.
 */
struct EsmMap *esm_map_open(const char *file);

/*
 Closes a map. Robots in it keep what they need. NULL is allowed.

 # Safety
 `map` comes from `esm_map_open` and is not used again.
 */
void esm_map_close(struct EsmMap *map);

/*
 A robot that may be anywhere in the map. `settings` is TOML as `esm-cli config` prints it, or NULL for the defaults. NULL where
 the settings are refused.

 # Safety
 `map` comes from `esm_map_open`; `settings` is NULL or a string that ends with a NUL.
 */
struct EsmRobot *esm_robot_new(const struct EsmMap *map,
                               const char *settings);

/*
 Frees a robot. NULL is allowed.

 # Safety
 `robot` comes from `esm_robot_new` and is not used again.
 */
void esm_robot_free(struct EsmRobot *robot);

/*
 Takes the next sweep and finds the cloud that ends with it.

 `points`: `count` points in the sensor frame, metres, each three floats x y z, `stride` bytes from one to the next (12 for packed
 ones, 16 for PCL's PointXYZ, `point_step` of a PointCloud2 whose x is at offset 0); alignment does not matter. `pose_odom_sensor`:
 where the sensor is by the robot's odometry, or NULL for a cloud by itself. Only its changes matter.

 # Safety
 `robot` comes from `esm_robot_new` and is not in use on another thread; `points` points to what is said; `pose_odom_sensor` is
 NULL or points to a pose; `answer` points to room for an answer.
 */
enum EsmStatus esm_robot_push(struct EsmRobot *robot,
                              double stamp,
                              const float *points,
                              size_t count,
                              size_t stride,
                              const struct EsmPose *pose_odom_sensor,
                              struct EsmAnswer *answer);

/*
 Forgets where the robot was and what it saw last: after a gap, or when it was carried elsewhere. NULL is allowed.

 # Safety
 `robot` comes from `esm_robot_new` and is not in use on another thread.
 */
void esm_robot_forget(struct EsmRobot *robot);

#ifdef __cplusplus
}  // extern "C"
#endif  // __cplusplus

#endif  /* ESM_H */
