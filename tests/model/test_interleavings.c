/* SPDX-License-Identifier: MIT */
/*
 * Goal: whatever order clients, daemon and disk act in, the rules of busy and free hold, and no reader
 * that keeps the rule of drawing ever draws what is not there.
 * Method: a world of two clients and two nodes around the daemon's own code.  From its first state
 * every step is taken in turn, from each state that gives again, until no state is new; breadth
 * first, so that the way to a violation is the shortest.
 *
 * OOCD_MODEL_WHOLE makes the world as large as it can be: some minutes.
 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include <signal.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "formats/base/check.h"
#include "tests/helper.h"
#include "tests/model/region.h"
#include "tests/model/small_world.h"

#define STATES_MAX  (1u << 24)
#define SLOTS_COUNT (2 * STATES_MAX)

/* How a state was come to first. */
struct origin {
	uint32_t state;
	struct step step;
};

struct search {
	struct world *world;
	struct origin *origins;       /* of each state */
	struct region_state **states; /* NULL once all its steps were taken */
	uint64_t *slots;              /* keys' hashes, open addressing; 0: none */
	uint32_t state_count;
	uint64_t step_count;
	uint64_t taken[STEP_KIND_COUNT_];
	/* What is being done, for who looks at a failure. */
	uint32_t state;
	struct step step;
};

static struct search search;

/* ---- failures ---- */

static void print_way(uint32_t state)
{
	uint32_t way[256];
	uint32_t count = 0;

	for (; state > 0 && count < 256; state = search.origins[state].state)
		way[count++] = state;
	while (count > 0)
		(void)fprintf(stderr, "  %s\n", step_text(search.origins[way[--count]].step));
}

/* A CHECK() of the daemon or of the world has failed. */
static void on_abort(int signal)
{
	(void)signal;
	(void)fprintf(stderr, "the way there:\n");
	print_way(search.state);
	(void)fprintf(stderr, "  %s\n", step_text(search.step));
	_exit(1);
}

/* ---- the search ---- */

/* FNV-1a, Fowler, Noll and Vo, then mixed: two keys of a million fall together once in 10^7 runs. */
static uint64_t hash_of(const uint8_t *bytes, size_t count)
{
	uint64_t hash = UINT64_C(0xcbf29ce484222325);

	for (size_t i = 0; i < count; i++)
		hash = (hash ^ bytes[i]) * UINT64_C(0x100000001b3);
	hash = (hash ^ hash >> 32) * UINT64_C(0x9e3779b97f4a7c15);
	return hash == 0 ? 1 : hash;
}

/* Returns: was it new? */
static bool remember(uint64_t hash)
{
	uint64_t at = hash % SLOTS_COUNT;

	while (search.slots[at] != 0 && search.slots[at] != hash)
		at = (at + 1) % SLOTS_COUNT;
	if (search.slots[at] == hash)
		return false;
	search.slots[at] = hash;
	return true;
}

static void add_if_new(void)
{
	uint8_t key[WORLD_KEY_BYTES];

	if (!remember(hash_of(key, world_key(search.world, key))))
		return;
	if (search.state_count == STATES_MAX)
		fail_msg("more than %u states", STATES_MAX);
	search.origins[search.state_count] = (struct origin){ search.state, search.step };
	search.states[search.state_count] = region_save();
	search.state_count++;
}

static void take_all_steps(uint32_t state)
{
	struct step steps[WORLD_STEPS_MAX];
	uint32_t count;

	search.state = state;
	region_load(search.states[state]);
	count = world_steps(search.world, steps);
	for (uint32_t i = 0; i < count; i++) {
		if (i > 0)
			region_load(search.states[state]);
		search.step = steps[i];
		world_take(search.world, steps[i]);
		world_check(search.world);
		search.step_count++;
		search.taken[steps[i].kind]++;
		add_if_new();
	}
	free(search.states[state]);
	search.states[state] = NULL;
}

static bool is_whole(void)
{
	return getenv("OOCD_MODEL_WHOLE") != NULL;
}

static void explore(uint32_t room_pages)
{
	struct sigaction action = { .sa_handler = on_abort };

	search = (struct search){
		.origins = calloc(STATES_MAX, sizeof(*search.origins)),
		.states = calloc(STATES_MAX, sizeof(struct region_state *)),
		.slots = calloc(SLOTS_COUNT, sizeof(*search.slots)),
	};
	assert_non_null(search.origins);
	assert_non_null(search.states);
	assert_non_null(search.slots);
	(void)sigaction(SIGABRT, &action, NULL);
	search.world = world_create(room_pages, is_whole());
	region_note_base();
	add_if_new();
	for (uint32_t state = 0; state < search.state_count; state++)
		take_all_steps(state);
	print_message("room for %u: %u states, %llu steps\n", room_pages, search.state_count,
		      (unsigned long long)search.step_count);
	free(search.origins);
	free(search.states);
	free(search.slots);
	/* Every kind of step was possible: nothing was left out by a mistake of the world. */
	for (uint32_t kind = 0; kind < STEP_KIND_COUNT_; kind++)
		/* With room for all nobody is given up for. */
		if (search.taken[kind] == 0 && (kind != STEP_GIVE_UP || room_pages == 1))
			fail_msg("no step of kind %u was ever possible", kind);
}

static void with_room_for_one_node_every_order_is_safe(void **state)
{
	(void)state;
	explore(1);
}

static void with_room_for_both_and_a_third_that_evicts_every_order_is_safe(void **state)
{
	(void)state;
	if (!is_whole())
		skip();
	explore(2);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(with_room_for_one_node_every_order_is_safe),
		cmocka_unit_test(with_room_for_both_and_a_third_that_evicts_every_order_is_safe),
	};

	return TEST_RUN(tests);
}
