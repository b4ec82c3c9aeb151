/* The UDP packets between a robot's controller and the mjx-cutting policy server, in C99 (and C++11).
 *
 * Layout and conversation: docs/protocol.md. Every field is naturally aligned, so the structs need no packing
 * pragma; the sizes below are checked at compile time. The wire is little-endian: on a big-endian machine
 * this header does not compile. No allocation, no dependency but the C library.
 *
 *   struct mjxc_state s = {0};
 *   ... fill s ...
 *   mjxc_seal(&s, sizeof s, MJXC_STATE, session, challenge, ++sequence, time_ns, key, key_size);
 *   send(socket, &s, sizeof s, 0);
 *
 *   if (mjxc_check(buffer, received, key, key_size) == MJXC_COMMAND) { ... memcpy to a struct mjxc_command ... }
 */
#ifndef MJXC_PROTOCOL_H
#define MJXC_PROTOCOL_H

#include <math.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>

#if defined(__BYTE_ORDER__) && __BYTE_ORDER__ != __ORDER_LITTLE_ENDIAN__
#error "mjx-cutting packets are little-endian; convert each field on this machine"
#endif

#define MJXC_VERSION 1
#define MJXC_SIGNED 0x0001u
#define MJXC_PORT 50500

enum { MJXC_HELLO = 1, MJXC_WELCOME, MJXC_ARM, MJXC_START, MJXC_STOP, MJXC_DISARM, MJXC_STATE, MJXC_COMMAND };
enum { MJXC_MODE_IDLE, MJXC_MODE_ARMED, MJXC_MODE_RUNNING, MJXC_MODE_SAFE_STOP, MJXC_MODE_FAULT };
enum {
    MJXC_CAUSE_NONE, MJXC_CAUSE_REQUESTED, MJXC_CAUSE_FINISHED, MJXC_CAUSE_STALE, MJXC_CAUSE_FORCE,
    MJXC_CAUSE_DEVIATION, MJXC_CAUSE_ROBOT, MJXC_CAUSE_RANGE, MJXC_CAUSE_POLICY, MJXC_CAUSE_SHUTDOWN,
    MJXC_CAUSE_OVERRUN
};
enum {
    MJXC_ROBOT_READY = 1, MJXC_ROBOT_FAULT = 2, MJXC_ROBOT_FINISHED = 4, MJXC_ROBOT_SPINDLE_ANGLE = 8,
    MJXC_ROBOT_SPINDLE_SPEED = 16
};
/* What mjxc_check returns for bytes that are no packet: the negative of Python's Reject. */
enum {
    MJXC_REJECT_SIZE = -1, MJXC_REJECT_MAGIC = -2, MJXC_REJECT_VERSION = -3, MJXC_REJECT_TYPE = -4,
    MJXC_REJECT_CRC = -5, MJXC_REJECT_KEY = -6, MJXC_REJECT_FIELD = -7, MJXC_REJECT_VALUE = -8
};

struct mjxc_header {
    uint8_t magic[4]; /* "MJXC" */
    uint8_t version;
    uint8_t type;
    uint16_t flags;     /* bit 0: signed */
    uint32_t session;   /* drawn by the controller, not 0 */
    uint32_t sequence;  /* from 1, each side its own, never back */
    uint64_t challenge; /* drawn by the server; 0 in HELLO */
    uint64_t time_ns;   /* sender's monotonic clock */
};

struct mjxc_trailer {
    uint32_t crc32; /* of all bytes before it */
    uint32_t reserved;
    uint8_t tag[32]; /* HMAC-SHA256 of all bytes before it, or zeros */
};

struct mjxc_control { /* HELLO, ARM, START, STOP, DISARM */
    struct mjxc_header header;
    struct mjxc_trailer trailer;
};

struct mjxc_welcome {
    struct mjxc_header header;
    uint8_t policy_sha256[32];
    uint32_t period_us;
    uint32_t hold_us;
    double nominal_feed_m_s;
    double low[5], high[5], rate_per_s[5], initial[5]; /* rate of ln for the gains; 0: unlimited */
    struct mjxc_trailer trailer;
};

struct mjxc_state {
    struct mjxc_header header;
    uint32_t flags; /* MJXC_ROBOT_* */
    uint32_t command_sequence;
    double path_error_m[3]; /* reference minus actual, base axes */
    double velocity_m_s[3];
    double position_m[3];
    double force_n[3]; /* on the tool, one raw sample, base axes */
    double speed_along_m_s;
    double path_m;
    double cut_length_m;
    double spindle_angle_rad;
    double spindle_speed_rev_s;
    struct mjxc_trailer trailer;
};

struct mjxc_command {
    struct mjxc_header header;
    uint32_t answers; /* sequence of the newest STATE used */
    uint8_t mode;     /* MJXC_MODE_* */
    uint8_t cause;    /* MJXC_CAUSE_* */
    uint16_t reserved;
    uint32_t period_us; /* interpolate to the set-points over this time */
    uint32_t hold_us;   /* stop by yourself this long after the newest COMMAND */
    uint64_t answers_time_ns;
    double set_point[5]; /* stiffness x, y, z [s^-2], feed adjustment [1], depth [m] */
    struct mjxc_trailer trailer;
};

typedef char mjxc_sizes_agree[(sizeof(struct mjxc_header) == 32 && sizeof(struct mjxc_trailer) == 40 &&
                               sizeof(struct mjxc_control) == 72 && sizeof(struct mjxc_welcome) == 280 &&
                               sizeof(struct mjxc_state) == 216 && sizeof(struct mjxc_command) == 136)
                                  ? 1
                                  : -1];

/* CRC-32 as in zlib and Ethernet (reflected polynomial 0xEDB88320). */
static inline uint32_t mjxc_crc32(const void *data, size_t size) {
    const uint8_t *byte = (const uint8_t *)data;
    uint32_t crc = 0xFFFFFFFFu;
    for (size_t i = 0; i < size; i++) {
        crc ^= byte[i];
        for (int bit = 0; bit < 8; bit++) crc = (crc >> 1) ^ (0xEDB88320u & (0u - (crc & 1u)));
    }
    return ~crc;
}

struct mjxc_sha256 {
    uint32_t h[8];
    uint8_t block[64];
    uint64_t size;
};

static inline uint32_t mjxc_rotate(uint32_t x, int n) { return (x >> n) | (x << (32 - n)); }

static inline void mjxc_sha256_block(struct mjxc_sha256 *s) { /* FIPS 180-4 */
    static const uint32_t K[64] = {
        0x428a2f98, 0x71374491, 0xb5c0fbcf, 0xe9b5dba5, 0x3956c25b, 0x59f111f1, 0x923f82a4, 0xab1c5ed5,
        0xd807aa98, 0x12835b01, 0x243185be, 0x550c7dc3, 0x72be5d74, 0x80deb1fe, 0x9bdc06a7, 0xc19bf174,
        0xe49b69c1, 0xefbe4786, 0x0fc19dc6, 0x240ca1cc, 0x2de92c6f, 0x4a7484aa, 0x5cb0a9dc, 0x76f988da,
        0x983e5152, 0xa831c66d, 0xb00327c8, 0xbf597fc7, 0xc6e00bf3, 0xd5a79147, 0x06ca6351, 0x14292967,
        0x27b70a85, 0x2e1b2138, 0x4d2c6dfc, 0x53380d13, 0x650a7354, 0x766a0abb, 0x81c2c92e, 0x92722c85,
        0xa2bfe8a1, 0xa81a664b, 0xc24b8b70, 0xc76c51a3, 0xd192e819, 0xd6990624, 0xf40e3585, 0x106aa070,
        0x19a4c116, 0x1e376c08, 0x2748774c, 0x34b0bcb5, 0x391c0cb3, 0x4ed8aa4a, 0x5b9cca4f, 0x682e6ff3,
        0x748f82ee, 0x78a5636f, 0x84c87814, 0x8cc70208, 0x90befffa, 0xa4506ceb, 0xbef9a3f7, 0xc67178f2};
    uint32_t w[64], v[8];
    for (int i = 0; i < 16; i++)
        w[i] = (uint32_t)s->block[4 * i] << 24 | (uint32_t)s->block[4 * i + 1] << 16 |
               (uint32_t)s->block[4 * i + 2] << 8 | s->block[4 * i + 3];
    for (int i = 16; i < 64; i++)
        w[i] = w[i - 16] + w[i - 7] +
               (mjxc_rotate(w[i - 15], 7) ^ mjxc_rotate(w[i - 15], 18) ^ (w[i - 15] >> 3)) +
               (mjxc_rotate(w[i - 2], 17) ^ mjxc_rotate(w[i - 2], 19) ^ (w[i - 2] >> 10));
    memcpy(v, s->h, sizeof v);
    for (int i = 0; i < 64; i++) {
        uint32_t e = mjxc_rotate(v[4], 6) ^ mjxc_rotate(v[4], 11) ^ mjxc_rotate(v[4], 25);
        uint32_t a = mjxc_rotate(v[0], 2) ^ mjxc_rotate(v[0], 13) ^ mjxc_rotate(v[0], 22);
        uint32_t t = v[7] + e + ((v[4] & v[5]) ^ (~v[4] & v[6])) + K[i] + w[i];
        uint32_t u = a + ((v[0] & v[1]) ^ (v[0] & v[2]) ^ (v[1] & v[2]));
        memmove(v + 1, v, 7 * sizeof v[0]);
        v[4] += t;
        v[0] = t + u;
    }
    for (int i = 0; i < 8; i++) s->h[i] += v[i];
}

static inline void mjxc_sha256_start(struct mjxc_sha256 *s) {
    static const uint32_t H[8] = {0x6a09e667, 0xbb67ae85, 0x3c6ef372, 0xa54ff53a,
                                  0x510e527f, 0x9b05688c, 0x1f83d9ab, 0x5be0cd19};
    memcpy(s->h, H, sizeof H);
    s->size = 0;
}

static inline void mjxc_sha256_add(struct mjxc_sha256 *s, const void *data, size_t size) {
    for (size_t i = 0; i < size; i++) {
        s->block[s->size++ % 64] = ((const uint8_t *)data)[i];
        if (s->size % 64 == 0) mjxc_sha256_block(s);
    }
}

static inline void mjxc_sha256_end(struct mjxc_sha256 *s, uint8_t digest[32]) {
    uint64_t bits = s->size * 8;
    uint8_t one = 0x80, zero = 0, length[8];
    mjxc_sha256_add(s, &one, 1);
    while (s->size % 64 != 56) mjxc_sha256_add(s, &zero, 1);
    for (int i = 0; i < 8; i++) length[i] = (uint8_t)(bits >> (56 - 8 * i));
    mjxc_sha256_add(s, length, 8);
    for (int i = 0; i < 32; i++) digest[i] = (uint8_t)(s->h[i / 4] >> (24 - 8 * (i % 4)));
}

/* HMAC-SHA256 (RFC 2104). */
static inline void mjxc_hmac(const void *key, size_t key_size, const void *data, size_t size, uint8_t tag[32]) {
    struct mjxc_sha256 s;
    uint8_t pad[64] = {0}, inner[32];
    if (key_size > 64) {
        mjxc_sha256_start(&s);
        mjxc_sha256_add(&s, key, key_size);
        mjxc_sha256_end(&s, pad);
    } else {
        memcpy(pad, key, key_size);
    }
    for (int i = 0; i < 64; i++) pad[i] ^= 0x36;
    mjxc_sha256_start(&s);
    mjxc_sha256_add(&s, pad, 64);
    mjxc_sha256_add(&s, data, size);
    mjxc_sha256_end(&s, inner);
    for (int i = 0; i < 64; i++) pad[i] ^= 0x36 ^ 0x5c;
    mjxc_sha256_start(&s);
    mjxc_sha256_add(&s, pad, 64);
    mjxc_sha256_add(&s, inner, 32);
    mjxc_sha256_end(&s, tag);
}

/* Fills the header and trailer of a packet struct whose payload stands. key NULL: unsigned. */
static inline void mjxc_seal(void *packet, size_t size, uint8_t type, uint32_t session, uint64_t challenge,
                             uint32_t sequence, uint64_t time_ns, const void *key, size_t key_size) {
    struct mjxc_header header = {{'M', 'J', 'X', 'C'}, MJXC_VERSION, 0, 0, 0, 0, 0, 0};
    struct mjxc_trailer trailer;
    uint8_t *byte = (uint8_t *)packet;
    size_t end = size - sizeof trailer;
    header.type = type;
    header.flags = key ? MJXC_SIGNED : 0;
    header.session = session;
    header.sequence = sequence;
    header.challenge = challenge;
    header.time_ns = time_ns;
    memcpy(byte, &header, sizeof header);
    memset(&trailer, 0, sizeof trailer);
    trailer.crc32 = mjxc_crc32(byte, end);
    memcpy(byte + end, &trailer, sizeof trailer);
    if (key) mjxc_hmac(key, key_size, byte, size - 32, byte + size - 32);
}

/* The packet's type, or a negative MJXC_REJECT_*. Session, challenge and sequence are the caller's to check. */
static inline int mjxc_check(const void *data, size_t size, const void *key, size_t key_size) {
    static const uint16_t sizes[9] = {0, 72, 280, 72, 72, 72, 72, 216, 136};
    static const uint8_t first_double[9] = {0, 32, 72, 32, 32, 32, 32, 40, 56};
    const uint8_t *byte = (const uint8_t *)data;
    struct mjxc_header header;
    struct mjxc_trailer trailer;
    uint8_t tag[32] = {0}, differs = 0;
    if (size < 72) return MJXC_REJECT_SIZE;
    memcpy(&header, byte, sizeof header);
    if (memcmp(header.magic, "MJXC", 4) != 0) return MJXC_REJECT_MAGIC;
    if (header.version != MJXC_VERSION) return MJXC_REJECT_VERSION;
    if (header.type < MJXC_HELLO || header.type > MJXC_COMMAND) return MJXC_REJECT_TYPE;
    if (size != sizes[header.type]) return MJXC_REJECT_SIZE;
    memcpy(&trailer, byte + size - sizeof trailer, sizeof trailer);
    if (mjxc_crc32(byte, size - sizeof trailer) != trailer.crc32) return MJXC_REJECT_CRC;
    if (key) mjxc_hmac(key, key_size, byte, size - 32, tag);
    for (int i = 0; i < 32; i++) differs |= (uint8_t)(tag[i] ^ trailer.tag[i]);
    if (key ? header.flags != MJXC_SIGNED : (header.flags & MJXC_SIGNED) != 0) return MJXC_REJECT_KEY;
    if (differs) return MJXC_REJECT_KEY;
    if (trailer.reserved || header.flags & ~MJXC_SIGNED || !header.sequence || !header.session)
        return MJXC_REJECT_FIELD;
    if (header.type == MJXC_COMMAND && (byte[36] > MJXC_MODE_FAULT || byte[37] > MJXC_CAUSE_OVERRUN ||
                                        byte[38] || byte[39]))
        return MJXC_REJECT_FIELD;
    for (size_t at = first_double[header.type]; at + 8 <= size - sizeof trailer; at += 8) {
        double value;
        memcpy(&value, byte + at, 8);
        if (!isfinite(value)) return MJXC_REJECT_VALUE;
    }
    return header.type;
}

#endif
