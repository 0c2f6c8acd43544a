/* SPDX-License-Identifier: MIT */
/**
 * selector.h - the inside of a struct selector, for the modules that select.
 *
 * Threads: those of select.h.
 */
#ifndef LIBCLIENT_SELECT_SELECTOR_H
#define LIBCLIENT_SELECT_SELECTOR_H

#include "libclient/select/bounds.h"
#include "libclient/select/hiding.h"
#include "libclient/select/places.h"
#include "libclient/select/select.h"

/** A cell of the front with its place in the order: the key's bits, then the time of arrival. */
struct front_entry {
	uint64_t key;
	uint32_t cell;
};

struct selector {
	const struct store_node *nodes;
	uint32_t node_count;
	struct places places;  /* the first node_count of them are the nodes */
	struct bounds *bounds; /* a node */
	struct hiding hiding;

	/* Scratch of one call.  A place or node is marked when its mark is the call's number. */
	uint32_t call;
	uint32_t *enqueued;        /* a place: it was in the front, or is out of view */
	uint32_t *selected;        /* a node */
	struct front_entry *front; /* a queue in the order of arrival, or a heap */
	uint32_t *front_slot;      /* a place: where in the heap it is */
	float *depth;              /* a place in the front: what hides it */
	struct selection_entry *entries;
	uint64_t *sort_keys; /* distance in the high half, node in the low half */
	uint64_t *sort_spare;
};

/** Begins a call: nothing is marked, and ret is empty. */
void selection_begin(struct selector *selector, struct selection *ret);

/** Adds a node behind the others; importance falls with the place in the list. */
void selection_add(struct selector *selector, uint32_t node, struct selection *ret);

/** Adds the candidates that are not selected yet, by distance, until the budget is spent. */
void selection_add_candidates(struct selector *selector, const struct view_planes *planes,
			      uint64_t budget_triangles, struct selection *ret);

/**
 * The walk of select_approximate() in the orders that need one: adds what it reaches.
 *
 * Returns: is budget left?
 */
bool select_walk(struct selector *selector, const struct view_planes *planes,
		 const struct select_options *options, struct selection *ret);

#endif /* LIBCLIENT_SELECT_SELECTOR_H */
