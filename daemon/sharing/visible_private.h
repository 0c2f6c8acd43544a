/* SPDX-License-Identifier: MIT */
/** visible_private.h - what the two files of a set share: visible.c (sets), visible_admit.c (wants). */
#ifndef DAEMON_SHARING_VISIBLE_PRIVATE_H
#define DAEMON_SHARING_VISIBLE_PRIVATE_H

#include "daemon/cache/recorder.h"
#include "daemon/sharing/visible.h"

/**
 * Counts a want of a node in, or out: what is wanted of the cache at all.  What nobody wants is not
 * planned any longer.
 */
void want_count_in(struct visible *visible, const struct want *want);
void want_count_out(struct visible *visible, const struct want *want);

static inline void want_record(const struct visible *visible, enum trace_kind kind,
			       const struct want *want)
{
	recorder_want(visible_served_of(visible, want), kind, visible->session, want->node);
}

/**
 * On its way, and the client was never told that it cannot have it now.  One that was refused has had
 * its answer: where others' sets change all the time it is admitted and refused again and again, and
 * whoever waits for the set would wait for ever.
 */
static inline bool want_is_unanswered(const struct want *want)
{
	return (want->state == WANT_QUEUED || want->state == WANT_WAITING) &&
	       want->told == WIRE_REASON_NONE;
}

/** Counts a node that the set has begun to want: it is there, or missed. */
void want_count_new(struct visible *visible, struct want *want);

/** Gives a hold up, its grant first. */
void want_release(struct visible *visible, struct want *want);

void want_refuse(struct visible *visible, struct want *want, enum wire_reason reason);

/** Gives a want that has room the state that its node's state says. */
void want_admit(struct visible *visible, struct want *want);

/**
 * Adds what of the set is not planned to the newest division, if that has left so much.
 *
 * Returns: false when it has not; then nothing has changed.
 */
bool visible_plan_rest(struct visible *visible);

#endif /* DAEMON_SHARING_VISIBLE_PRIVATE_H */
