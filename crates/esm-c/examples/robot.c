/* A robot that finds itself: sweeps from standard input, one line of answer for each on standard output.
 *
 *   robot MAP.esm [SETTINGS.toml] < sweeps
 *
 * One thread, no allocation of its own after the start, no runtime. A sweep on standard input is
 *
 *   f64 stamp, f64 position x y z, f64 orientation x y z w (pose of the sensor by odometry), u64 count, count times f32 x y z
 *
 * in the machine's byte order: what the driver of your sensor and your odometry hand over.
 */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "esm.h"

#define MOST_POINTS 200000
#define MOST_SETTINGS 65536

static float points[3 * MOST_POINTS];
static char settings[MOST_SETTINGS];

static int stop(const char *what) {
    fprintf(stderr, "error: %s: %s\n", what, esm_last_error());
    return 2;
}

/* The settings file as a string, NULL where there is none. */
static const char *read_settings(const char *file) {
    FILE *in = fopen(file, "rb");
    if (!in) {
        return NULL;
    }
    size_t n = fread(settings, 1, MOST_SETTINGS - 1, in);
    settings[n] = '\0';
    fclose(in);
    return settings;
}

static const char *word(EsmVerdict verdict) {
    switch (verdict) {
    case ESM_VERDICT_LOCATED: return "located";
    case ESM_VERDICT_AMBIGUOUS: return "ambiguous";
    case ESM_VERDICT_NOT_FOUND: return "not_found";
    default: return "no_cloud";
    }
}

int main(int argc, char **argv) {
    if (argc < 2) {
        fprintf(stderr, "usage: %s MAP.esm [SETTINGS.toml] < sweeps\n", argv[0]);
        return 2;
    }
    const char *toml = NULL;
    if (argc > 2 && !(toml = read_settings(argv[2]))) {
        fprintf(stderr, "error: %s cannot be read\n", argv[2]);
        return 2;
    }
    if (esm_use_one_thread() != ESM_STATUS_OK) {
        return stop("threads");
    }
    EsmMap *map = esm_map_open(argv[1]);
    if (!map) {
        return stop("map");
    }
    EsmRobot *robot = esm_robot_new(map, toml);
    esm_map_close(map); /* the robot keeps what it needs */
    if (!robot) {
        return stop("robot");
    }

    double head[8];
    uint64_t count;
    while (fread(head, sizeof head, 1, stdin) == 1 && fread(&count, sizeof count, 1, stdin) == 1) {
        if (count > MOST_POINTS || fread(points, 3 * sizeof(float), count, stdin) != count) {
            fprintf(stderr, "error: a sweep of %llu points is torn, or more than %d\n", (unsigned long long)count, MOST_POINTS);
            esm_robot_free(robot);
            return 2;
        }
        EsmPose pose_odom_sensor;
        memcpy(pose_odom_sensor.position, head + 1, sizeof pose_odom_sensor.position);
        memcpy(pose_odom_sensor.orientation, head + 4, sizeof pose_odom_sensor.orientation);
        EsmAnswer answer;
        if (esm_robot_push(robot, head[0], points, count, 3 * sizeof(float), &pose_odom_sensor, &answer) != ESM_STATUS_OK) {
            esm_robot_free(robot);
            return stop("sweep");
        }
        const double *p = answer.pose_map_sensor.position, *q = answer.pose_map_sensor.orientation;
        printf("%.9f %s %.17g %.17g %.17g %.17g %.17g %.17g %.17g %u\n", answer.stamp, word(answer.verdict), p[0], p[1],
               p[2], q[0], q[1], q[2], q[3], answer.inliers);
        fflush(stdout);
    }
    esm_robot_free(robot);
    return 0;
}
