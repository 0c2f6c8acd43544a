/* SPDX-License-Identifier: MIT */
/**
 * limits.h - every limit of the daemon, in one place, and how they relate.
 *
 * Reaching a limit has a defined answer; nothing grows without bound.
 */
#ifndef DAEMON_LIMITS_H
#define DAEMON_LIMITS_H

#include <assert.h>

#include "formats/base/bytes.h"
#include "formats/store/layout.h"
#include "libclient/wire.h"

/** Clients at one time; the next one is told so and closed. */
#define SESSION_COUNT_MAX 1024u
/** And of one user, unless its policy says otherwise: half, so that no user keeps all others out. */
#define ACCOUNT_SESSION_COUNT_MAX (SESSION_COUNT_MAX / 2)
/** Accounts kept for what they say of users who are not connected. */
#define ACCOUNT_COUNT_KEPT 64u
/** A user's weight, unless its policy says otherwise. */
#define ACCOUNT_WEIGHT_USUAL 100u
/** Lines about one user's clients in so many seconds; what comes beyond is only counted. */
#define ACCOUNT_LOG_LINES_MAX 10u
#define ACCOUNT_LOG_SECONDS   10u
/** Connections taken in one round, so that a storm of them starves nobody who is connected. */
#define ACCEPT_COUNT_MAX 8u
/** And nobody for so long after one was turned away, who may come back as fast as that. */
#define REFUSAL_PAUSE_US 500u
/** Stores open at one time, idle ones included. */
#define SERVED_COUNT_MAX 256u
/** Segments of all stores together: entries of the ring's table of buffers. */
#define SEGMENT_COUNT_MAX 4096u
/** Seconds that a connection may take to say HELLO. */
#define HELLO_SECONDS_MAX 5u
/** Seconds that a client may leave unread what it is owed. */
#define STALL_SECONDS_MAX 30u

/** Sizes of segments: what is usual, and what small and huge caches use. */
#define SEGMENT_BYTES_MIN   (64u * KIB)
#define SEGMENT_BYTES_USUAL (64u * MIB)
#define SEGMENT_BYTES_MAX   ((uint64_t)WIRE_SEGMENT_PAGES_MAX * WIRE_PAGE_BYTES)
#define CACHE_BYTES_MIN     MIB
#define CACHE_BYTES_MAX     ((uint64_t)SEGMENT_COUNT_MAX * SEGMENT_BYTES_MAX)

/** With 1 / this of the budget unpinned, no fill shall fail for want of a long enough window. */
#define FRAGMENTED_SHARE 20u

/** After dividing the cache, so many times as long for other things, before it is divided again. */
#define DIVISION_PAUSE 8u
/**
 * Between two EVENTs of one session, for each session that there is: some 4,000 a second wake clients, whatever
 * goes on.  What settles or completes a set is told at once.
 */
#define EVENT_PAUSE_US 250u
/** Telling wakes clients, who take the processor: after so long, messages are read before more is told. */
#define TELL_US_MAX 1000u
/** How long fetches wait for holds that are about to be given up, when none is given up meanwhile. */
#define LEAVING_MS_MAX 1000u
/** How long one of them waits in any case: others may take what is given up, again and again. */
#define ROOM_WAIT_MS_MAX 1000u
/** How long a client that is asked to let go may take until it is disconnected. */
#define LEASE_MS_USUAL 5000u
/** A session whose fetch waits for room is passed for so long, or until so much was released as it needs. */
#define ROOM_RETRY_MS 20u
/** A client that has been silent for so long is asked at once; others will say their set anyway. */
#define RECALL_SILENCE_MS 50u

/** Payloads being read or decoded at one time. */
#define FILL_COUNT_MAX 256u
/** A read is at most this long, so that what matters more overtakes quickly. */
#define FETCH_PIECE_BYTES (256u * KIB)
/** Requests that one read may serve, neighbours in the file. */
#define FETCH_PART_COUNT_MAX 32u
#define FETCH_DEPTH_USUAL    16u
#define FETCH_DEPTH_MAX      256u
/** Once the queue was full it is filled again when this part of it is free. */
#define FETCH_REFILL_SHARE 2u
/** Requests that take turns with their pieces; no more is begun while so many are half begun. */
#define FETCH_WAITING_MAX 4u
/** Of the queue, what one client's reads may take when others read as well: all but 1 / this. */
#define FETCH_RESERVE_SHARE 4u
/** Times that one piece may come back without progress. */
#define FETCH_RETRY_MAX 8u
/** Bytes that the loop verifies itself in a round, some 0.2 ms; more is for the workers. */
#define VERIFY_HERE_BYTES (2u * MIB)
/** Room for coded payloads on their way: twice the largest one at least. */
#define STAGING_BYTES_MIN (8u * MIB)
/** Prefetched bytes on their way: what a fetch may have to wait behind. */
#define PREFETCH_FLIGHT_BYTES (1u * MIB)
/** Of the cache, what one PREFETCH may fill, and again with each new set: 1 / this. */
#define PREFETCH_SHARE 4u
/** And how many nodes. */
#define PREFETCH_COUNT_MAX 1024u
/** Bytes of a client's turn when several wait for the disk. */
#define TURN_BYTES (512u * KIB)
/** And of one of its clients, at least. */
#define TURN_BYTES_MIN (16u * KIB)

/** Of the cache, what administrators may pin: 1 / this. */
#define RESIDENT_SHARE 2u
/** Tenths of a second after an eviction in which a fetch of the node regrets it. */
#define REGRET_DS 100u

/** Between two writes of the file of metrics. */
#define METRICS_SECONDS 10u

/** Lines about one store's failing nodes; what comes after is only counted. */
#define STORE_LOG_LINES_MAX 20u

#define WORKER_COUNT_MAX 64u
#define WORKER_NICE      10

static_assert(FILL_COUNT_MAX < UINT16_MAX - 1, "a node names its fill");
static_assert(SEGMENT_BYTES_MAX >= 2 * STORE_PAYLOAD_BYTES_MAX, "a segment holds any payload");
static_assert(SEGMENT_BYTES_MAX <= GIB, "a registered buffer has at most 1 GiB");
static_assert(SEGMENT_COUNT_MAX <= WIRE_SEGMENT_COUNT_MAX, "a word can name every segment");
static_assert(WIRE_PAGE_BYTES == STORE_BLOCK_BYTES, "extents are read straight into pages");
static_assert(FETCH_PIECE_BYTES % STORE_BLOCK_BYTES == 0, "pieces begin on blocks");

#endif /* DAEMON_LIMITS_H */
