/* Calls that no program should make: each is refused with words, and the robot goes on. */
#include <stdio.h>
#include <string.h>

#include "esm.h"

static int failures = 0;

static void refused(bool was, const char *words) {
    if (!was || !strstr(esm_last_error(), words)) {
        fprintf(stderr, "not refused with '%s': '%s'\n", words, esm_last_error());
        failures++;
    }
}

/* Threads of this process, by the kernel. */
static int threads(void) {
    FILE *status = fopen("/proc/self/status", "r");
    char line[256];
    int count = -1;
    while (status && fgets(line, sizeof line, status)) {
        if (sscanf(line, "Threads: %d", &count) == 1) {
            break;
        }
    }
    if (status) {
        fclose(status);
    }
    return count;
}

int main(int argc, char **argv) {
    if (argc < 2 || !strchr(esm_version(), '.') || esm_use_one_thread() != ESM_STATUS_OK) {
        return 3;
    }
    refused(esm_use_one_thread() != ESM_STATUS_OK, "first and once");
    refused(!esm_map_open(NULL), "file is NULL");
    refused(!esm_robot_new(NULL, NULL), "map is NULL");
    EsmMap *map = esm_map_open(argv[1]);
    refused(!esm_robot_new(map, "\xff\xfe"), "settings");
    refused(!esm_robot_new(map, "[pose]\nresolution_m = -1\n"), "pose.resolution_m");
    EsmRobot *robot = esm_robot_new(map, "[accumulate]\ndistance_m = 0\n");
    esm_map_close(map);
    if (!robot) {
        return 3;
    }

    float points[] = {1, 2, 3, 0, 4, 5, 6, 0};
    EsmAnswer answer;
    EsmPose here = {{0, 0, 0}, {0, 0, 0, 1}}, nowhere = {{0, 0, 0}, {0, 0, 0, 0}};
    refused(esm_robot_push(NULL, 1, points, 2, 16, &here, &answer) != ESM_STATUS_OK, "robot is NULL");
    refused(esm_robot_push(robot, 1, NULL, 2, 16, &here, &answer) != ESM_STATUS_OK, "points is NULL");
    refused(esm_robot_push(robot, 1, points, 2, 16, &here, NULL) != ESM_STATUS_OK, "answer is NULL");
    refused(esm_robot_push(robot, 1, points, 2, 8, &here, &answer) != ESM_STATUS_OK, "stride is 8");
    refused(esm_robot_push(robot, 1, points, (size_t)-1, 16, &here, &answer) != ESM_STATUS_OK, "more than");
    refused(esm_robot_push(robot, 1, points, 2, 16, &nowhere, &answer) != ESM_STATUS_OK, "unit quaternion");

    /* After all this it works; PCL's points, and once without odometry, unaligned. */
    char unaligned[1 + sizeof points];
    memcpy(unaligned + 1, points, sizeof points);
    if (esm_robot_push(robot, 2, points, 2, 16, &here, &answer) != ESM_STATUS_OK || answer.verdict != ESM_VERDICT_NOT_FOUND ||
        answer.has_pose || answer.stamp != 2 ||
        esm_robot_push(robot, 3, (const float *)(const void *)(unaligned + 1), 2, 16, NULL, &answer) != ESM_STATUS_OK) {
        fprintf(stderr, "does not go on: %s\n", esm_last_error());
        failures++;
    }
    if (threads() == 1) {
        puts("one thread");
    }
    esm_robot_forget(robot);
    esm_robot_free(robot);
    esm_robot_forget(NULL);
    esm_robot_free(NULL);
    esm_map_close(NULL);
    if (!failures) {
        puts("all refused");
    }
    return failures != 0;
}
