/* SPDX-License-Identifier: MIT */
/**
 * division.h - who may hold what when more is wanted than fits: the cache is divided among the sets.
 *
 * Each user's account is guaranteed a share of the cache: what its policy says, or its part of the
 * rest by weight.  An account's sessions that want something share it equally.  All sets are walked
 * at the same time, each from its most important node, in steps of a sixteenth of its session's
 * share; a node is *planned* when a walk comes to it and it still fits.  A walk ends where the next
 * node does not fit.  So every set has its most important nodes at least up to its share (but for
 * what one payload is too long), and what some do not claim goes to those who want more, by weight.
 *
 * That would move the ends of all walks a little whenever one set changes, and where many change nobody
 * would ever have what he was told he may have.  So the walks stop a step before their shares, and what is
 * planned, in memory and still wanted stays first; only then they go on.  A sixteenth of each share is lent
 * so, to what is there already.
 *
 * A payload that several sets want is in the cache once and takes its room once, and is charged to the
 * one whose walk comes to it first; the others have it for nothing, and go on with what that saves them.
 * So what is charged is what is taken, and nobody's sets take more by naming what his other sets name.
 *
 * Otherwise the plan is a function of the sets, the weights and the budget, and what is kept was planned
 * before.  So it stays the same for as long as no set changes: nothing can push back what pushed it out,
 * neither between clients nor inside one set, and all reads end.
 *
 * Threads: loop thread.
 * Source: max-min fairness by progressive filling, Bertsekas and Gallager (1992), sec. 6.5.2.
 */
#ifndef DAEMON_SHARING_DIVISION_H
#define DAEMON_SHARING_DIVISION_H

#include "daemon/sharing/room.h"
#include "daemon/sharing/visible.h"

/**
 * Brings all sets to what they may hold, if anything has changed that they depend on.
 *
 * Cost: O(1) when nothing has; O(all wants) when more is wanted than fits.
 */
void division_settle(struct room *room);

#endif /* DAEMON_SHARING_DIVISION_H */
