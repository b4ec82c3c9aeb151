/* A controller-side application in C99, as one on KUKA's FRI would be: between a policy server and a robot.
 *
 *     policy server  <-- UDP, 500 / 50 Hz -->  this program  <-- UDP, 500 / 500 Hz -->  robot (here the virtual cell)
 *
 * It holds the conversation with the server (HELLO, ARM, START), passes the robot's samples on, checks every
 * COMMAND, interpolates its set-points for the robot's next sample, and ramps to rest by itself when the server is
 * silent for longer than hold_us. The robot's side uses the same packets, so that the virtual cell can stand in for
 * it; an FRI application replaces `robot_receive` and `robot_send` by LBRClient's state and command.
 *
 * policy.h is the generated header of the exported policy (mjx-cutting export --format c). This program replays its
 * golden pairs and refuses a server whose policy is not the one compiled in.
 *
 *     gcc -std=c99 -O2 -Wall -Werror -I DEPLOY_FOLDER -I POLICY_FOLDER fri_client.c -o fri_client -lm
 *     ./fri_client SERVER_PORT [ROBOT_PORT]         both on 127.0.0.1; ends with status 0 after a finished cut
 */
#define _POSIX_C_SOURCE 200809L
#include <arpa/inet.h>
#include <poll.h>
#include <stdio.h>
#include <stdlib.h>
#include <sys/socket.h>
#include <time.h>
#include <unistd.h>

#include "policy.h"
#include "protocol.h"

enum { GAINS = 3, FEED = 3, SET_POINTS = 5 };
static const double REST = -1.0, FEED_RATE_S = 2.0;
static const uint64_t AGAIN_NS = 50000000, GIVE_UP_NS = 60000000000;

struct side { /* one conversation */
    int socket;
    struct sockaddr_in peer;
    uint32_t session, sequence, heard;
    uint64_t challenge;
};

struct follower { /* set-points on their way */
    double now[SET_POINTS], step[SET_POINTS]; /* logarithm of the gains; change in a nanosecond */
    uint64_t until_ns, at_ns, heard_ns, hold_ns;
    uint8_t mode, cause;
    int ran, silent;
};

static uint64_t clock_ns(void) {
    struct timespec now;
    clock_gettime(CLOCK_MONOTONIC, &now);
    return (uint64_t)now.tv_sec * 1000000000u + (uint64_t)now.tv_nsec;
}

static int open_socket(uint16_t port, int listens, struct sockaddr_in *at) {
    socklen_t size = sizeof *at;
    int opened = socket(AF_INET, SOCK_DGRAM, 0);
    memset(at, 0, sizeof *at);
    at->sin_family = AF_INET;
    at->sin_port = htons(port);
    at->sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    if (opened < 0) return -1;
    if (listens && (bind(opened, (struct sockaddr *)at, sizeof *at) || getsockname(opened, (struct sockaddr *)at, &size)))
        return -1;
    return opened;
}

static void send_packet(struct side *to, void *packet, size_t size, uint8_t type, uint64_t time_ns) {
    mjxc_seal(packet, size, type, to->session, type == MJXC_HELLO ? 0 : to->challenge, ++to->sequence, time_ns, NULL, 0);
    (void)!sendto(to->socket, packet, size, 0, (struct sockaddr *)&to->peer, sizeof to->peer); /* lost is lost */
}

static void ask(struct side *server, uint8_t type, uint64_t now_ns) {
    struct mjxc_control control;
    memset(&control, 0, sizeof control);
    send_packet(server, &control, sizeof control, type, now_ns);
}

static double inner(int k, double value) { return k < GAINS ? log(value) : value; }

/* 0, or -1 for set-points outside the limits that the policy was exported with. */
static int take(struct follower *f, const struct mjxc_command *c, const struct mjxc_welcome *w, uint64_t now_ns) {
    for (int k = 0; k < SET_POINTS; k++) {
        double low = k == FEED ? REST : w->low[k], slack = 1e-6 * (w->high[k] - w->low[k]);
        if (!(c->set_point[k] >= low - slack && c->set_point[k] <= w->high[k] + slack)) return -1;
    }
    f->heard_ns = now_ns;
    f->hold_ns = 1000u * (uint64_t)c->hold_us;
    if (f->silent) return 0; /* a server that comes back finds a robot that has stopped */
    f->mode = c->mode;
    f->cause = c->cause;
    f->ran |= c->mode == MJXC_MODE_RUNNING;
    f->until_ns = now_ns + 1000u * (uint64_t)c->period_us;
    for (int k = 0; k < SET_POINTS; k++)
        f->step[k] = (inner(k, c->set_point[k]) - f->now[k]) / (1e3 * (double)c->period_us);
    return 0;
}

static void advance(struct follower *f, uint64_t now_ns) {
    uint64_t from = f->at_ns, to = now_ns < f->until_ns ? now_ns : f->until_ns;
    f->at_ns = now_ns;
    if (f->mode == MJXC_MODE_RUNNING && now_ns - f->heard_ns > f->hold_ns) {
        f->silent = 1;
        f->mode = MJXC_MODE_SAFE_STOP;
        f->cause = MJXC_CAUSE_STALE;
    }
    if (f->silent) {
        f->now[FEED] -= FEED_RATE_S * 1e-9 * (double)(now_ns - from);
        if (f->now[FEED] <= REST) {
            f->now[FEED] = REST;
            f->mode = MJXC_MODE_FAULT;
        }
    } else if (to > from) {
        for (int k = 0; k < SET_POINTS; k++) f->now[k] += f->step[k] * (double)(to - from);
    }
}

static int same_policy(const struct mjxc_welcome *w) {
    char text[65];
    for (int i = 0; i < 32; i++) snprintf(text + 2 * i, 3, "%02x", w->policy_sha256[i]);
    return strcmp(text, MJX_CUTTING_POLICY_SHA256) == 0;
}

int main(int count, char **words) {
    struct side server = {0}, robot = {0};
    struct follower f = {0};
    struct sockaddr_in here;
    struct mjxc_welcome welcome;
    struct mjxc_command command;
    struct mjxc_state state;
    union { uint8_t bytes[512]; struct mjxc_header header; } in;
    uint32_t taken = 0;
    unsigned long states = 0, commands = 0, refused = 0;
    uint64_t begun = clock_ns(), asked = 0, worst_ns = 0, finished = 0;
    int welcomed = 0;

    if (count < 2) return fprintf(stderr, "usage: fri_client SERVER_PORT [ROBOT_PORT]\n"), 2;
    if (mjx_cutting_policy_verify() > 5e-5) return fprintf(stderr, "the golden pairs are not reproduced\n"), 3;
    server.socket = open_socket(0, 1, &here);
    robot.socket = open_socket((uint16_t)(count > 2 ? atoi(words[2]) : 0), 1, &here);
    if (server.socket < 0 || robot.socket < 0) return perror("socket"), 2;
    server.peer = here;
    server.peer.sin_port = htons((uint16_t)atoi(words[1]));
    server.session = (uint32_t)(begun ^ (begun >> 32)) | 1u;
    robot.challenge = begun;
    printf("robot port %d\n", ntohs(here.sin_port));
    fflush(stdout);

    while (clock_ns() - begun < GIVE_UP_NS && (!finished || clock_ns() - finished < 500000000u)) {
        struct pollfd wait[2] = {{server.socket, POLLIN, 0}, {robot.socket, POLLIN, 0}};
        struct sockaddr_in from;
        socklen_t size = sizeof from;
        uint64_t now = 0;
        poll(wait, 2, 1);
        now = clock_ns();
        if (!welcomed && now - asked > AGAIN_NS) {
            ask(&server, MJXC_HELLO, now);
            asked = now;
        }
        if (wait[0].revents & POLLIN) {
            ssize_t got = recv(server.socket, in.bytes, sizeof in.bytes, 0);
            int type = got < 0 ? 0 : mjxc_check(in.bytes, (size_t)got, NULL, 0);
            if (type == MJXC_WELCOME && !welcomed && in.header.session == server.session) {
                memcpy(&welcome, in.bytes, sizeof welcome);
                if (!same_policy(&welcome)) return fprintf(stderr, "the server has another policy\n"), 4;
                server.challenge = in.header.challenge;
                for (int k = 0; k < SET_POINTS; k++) f.now[k] = inner(k, welcome.initial[k]);
                f.now[FEED] = REST;
                f.at_ns = now;
                welcomed = 1;
            } else if (type == MJXC_COMMAND && welcomed && in.header.session == server.session &&
                       in.header.challenge == server.challenge && in.header.sequence > server.heard) {
                memcpy(&command, in.bytes, sizeof command);
                server.heard = in.header.sequence;
                advance(&f, now);
                if (take(&f, &command, &welcome, now))
                    refused++;
                else
                    commands++, taken = in.header.sequence;
            } else if (got >= 0)
                refused++;
        }
        if (!(wait[1].revents & POLLIN)) continue;
        ssize_t got = recvfrom(robot.socket, in.bytes, sizeof in.bytes, 0, (struct sockaddr *)&from, &size);
        int type = got < 0 ? 0 : mjxc_check(in.bytes, (size_t)got, NULL, 0);
        if (type == MJXC_HELLO && welcomed) { /* the robot is told the server's limits, and a short period */
            struct mjxc_welcome mine = welcome;
            robot.peer = from;
            robot.session = in.header.session;
            robot.heard = robot.sequence = 0;
            mine.period_us = 2000;
            send_packet(&robot, &mine, sizeof mine, MJXC_WELCOME, now);
        } else if (type > 0 && in.header.session == robot.session && in.header.challenge == robot.challenge &&
                   in.header.sequence > robot.heard) {
            robot.heard = in.header.sequence;
            if (type == MJXC_STATE) {
                uint64_t sampled = in.header.time_ns;
                struct mjxc_command reply;
                memcpy(&state, in.bytes, sizeof state);
                state.command_sequence = taken;
                send_packet(&server, &state, sizeof state, MJXC_STATE, sampled);
                advance(&f, now);
                memset(&reply, 0, sizeof reply);
                reply.answers = in.header.sequence;
                reply.answers_time_ns = sampled;
                reply.mode = f.mode;
                reply.cause = f.cause;
                reply.period_us = 2000;
                reply.hold_us = 50000;
                for (int k = 0; k < SET_POINTS; k++) reply.set_point[k] = k < GAINS ? exp(f.now[k]) : f.now[k];
                send_packet(&robot, &reply, sizeof reply, MJXC_COMMAND, now);
                states++;
                if (clock_ns() - now > worst_ns) worst_ns = clock_ns() - now;
                if (!finished && f.ran && (f.mode == MJXC_MODE_IDLE || f.mode == MJXC_MODE_FAULT)) finished = now;
            } else if (type >= MJXC_ARM && type <= MJXC_DISARM) {
                ask(&server, (uint8_t)type, now);
            }
        }
    }
    printf("%lu states, %lu commands, %lu refused, longest handling %.3f ms, ended %s\n", states, commands, refused,
           (double)worst_ns * 1e-6, f.mode == MJXC_MODE_IDLE && f.ran ? "idle" : f.silent ? "silent" : "otherwise");
    return f.mode == MJXC_MODE_IDLE && f.ran ? 0 : 1;
}
