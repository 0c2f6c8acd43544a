/* SPDX-License-Identifier: MIT */
/*
 * Goal: what a client may draw is never anything else than the node, while the daemon evicts and
 * refills as fast as it can.
 * Method: a cache that holds a fraction of the store; clients in processes of their own take random
 * sets and check every drawable payload's checksum again and again, also between sending a set and
 * its answer.  Most read from a set many times over; one is never content and says its next set as
 * soon as it has one, so that evictions never stop.  The rule of drawing is the protocol's: the newest
 * set that has the node since it was last without is acknowledged, the grant bit is set, the word says
 * READY.
 * And that the test bites: a reader that breaks the rule sees wrong bytes.
 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include <poll.h>
#include <sched.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <unistd.h>

#include "formats/base/bytes.h"
#include "formats/store/store_checksum.h"
#include "tests/helper.h"
#include "tests/integration/daemon_kit.h"

#define READER_COUNT 4u /* the first never content */
#define SET_NODES    24u
#define NODES_MAX    2048u
/* How much is enough, of all readers together. */
#define READS  100000u
#define SETS   200u
#define ROUNDS 32u
/* One read in so many is of a reader that loses the processor between its look and its draw. */
#define YIELDS 64u

struct tally {
	_Atomic uint64_t reads;
	_Atomic uint64_t torn;
	_Atomic uint64_t sets;
};

struct reader {
	struct kit_client *client;
	struct kit_store *store;
	struct tally *tally;
	bool keeps_the_rule;
	uint32_t rounds; /* of reading of a set, about */
	uint64_t since
		[NODES_MAX]; /* serial of the set since which every set has the node; 0: none */
	struct wire_entry entries[SET_NODES];
	uint32_t payloads[NODES_MAX];
	uint32_t payload_count;
};

/* Who breaks the rule goes on until it is caught, and no longer. */
static bool is_enough(const struct tally *tally, bool keeps_the_rule)
{
	return keeps_the_rule ? tally->reads >= test_repeats(READS) && tally->sets >= SETS
			      : tally->torn > 0;
}

/* A run of neighbours, so that sets overlap, chosen anew each time. */
static void next_set(struct reader *reader, unsigned *seed)
{
	uint32_t first = (uint32_t)rand_r(seed) % (reader->payload_count - SET_NODES);
	uint64_t serial = reader->client->serial + 1;

	for (uint32_t i = 0; i < reader->payload_count; i++) {
		uint32_t node = reader->payloads[i];

		if (i < first || i >= first + SET_NODES)
			reader->since[node] = 0;
		else if (reader->since[node] == 0)
			reader->since[node] = serial;
	}
	for (uint32_t i = 0; i < SET_NODES; i++)
		reader->entries[i] = (struct wire_entry){ 0, reader->payloads[first + i],
							  (float)(SET_NODES - i) };
	kit_set(reader->client, reader->entries, SET_NODES, WIRE_SET_RETIRE);
	atomic_fetch_add(&reader->tally->sets, 1);
}

static void take_what_came(struct reader *reader)
{
	struct pollfd poll_fd = { reader->client->fd, POLLIN, 0 };

	while (poll(&poll_fd, 1, 0) == 1)
		kit_receive_any(reader->client);
}

static void read_node(struct reader *reader, uint32_t node, unsigned *seed)
{
	const struct wire_session_page *page = reader->client->page;
	const struct store_node *record = &reader->store->nodes[node];
	const uint8_t *payload;

	if (reader->keeps_the_rule &&
	    (reader->since[node] == 0 ||
	     atomic_load_explicit(&page->acknowledged, memory_order_acquire) < reader->since[node]))
		return;
	payload = reader->keeps_the_rule ? kit_map(reader->store, node)
					 : kit_map_ungranted(reader->store, node);
	if (!payload)
		return;
	atomic_fetch_add_explicit(&reader->tally->reads, 1, memory_order_relaxed);
	if (rand_r(seed) % YIELDS == 0)
		(void)sched_yield();
	if (store_checksum(payload, record->stored_bytes, record->payload_id) !=
	    record->payload_checksum)
		atomic_fetch_add_explicit(&reader->tally->torn, 1, memory_order_relaxed);
}

static _Noreturn void reader_main(const struct kit_daemon *daemon, const char *path,
				  struct tally *tally, bool keeps_the_rule, uint32_t number)
{
	struct reader *reader = calloc(1, sizeof(*reader));
	const struct wire_session_page *page;
	unsigned seed = number + 1;

	reader->client = kit_hello(daemon);
	page = reader->client->page;
	reader->store = kit_open(reader->client, 0, path);
	reader->tally = tally;
	reader->keeps_the_rule = keeps_the_rule;
	reader->rounds = number == 0 ? 1 : ROUNDS;
	for (uint32_t i = 0; i < reader->store->node_count; i++)
		if (reader->store->nodes[i].payload_id > 0)
			reader->payloads[reader->payload_count++] = i;
	while (!is_enough(tally, keeps_the_rule)) {
		uint64_t serial = reader->client->serial;

		take_what_came(reader);
		/* Mostly a set is seen whole before the next; now and then it is not even answered. */
		if (serial == 0 || reader->client->recalled ||
		    rand_r(&seed) % (64 * reader->rounds) == 0 ||
		    (rand_r(&seed) % reader->rounds == 0 &&
		     atomic_load_explicit(rand_r(&seed) % 16 ? &page->settled : &page->acknowledged,
					  memory_order_acquire) == serial))
			next_set(reader, &seed);
		for (uint32_t i = 0; i < SET_NODES; i++)
			read_node(reader,
				  keeps_the_rule ? reader->entries[i].node
						 : reader->payloads[(uint32_t)rand_r(&seed) %
								    reader->payload_count],
				  &seed);
	}
	kit_disconnect(reader->client);
	free(reader);
	_exit(0);
}

static void run_readers(const char *folder, bool keep_the_rule, struct tally *tally)
{
	const struct test_grid grid = { .count = 12, .face_quads = 4 };
	const char *path = test_path(folder, "a.ooc");
	struct server_config config = kit_config();
	struct kit_daemon daemon;
	pid_t readers[READER_COUNT];

	test_store_grid_make(path, &grid);
	/* A quarter of the store: less than all readers want. */
	config.cache_bytes = MIB;
	kit_daemon_start(folder, &config, &daemon);
	for (uint32_t i = 0; i < READER_COUNT; i++) {
		readers[i] = test_fork();
		if (readers[i] == 0)
			reader_main(&daemon, path, tally, keep_the_rule, i);
	}
	for (uint32_t i = 0; i < READER_COUNT; i++)
		assert_int_equal(test_wait(readers[i]), 0);
	assert_int_equal(kit_daemon_stop(&daemon, SIGTERM), 0);
	print_message("%llu sets, %llu reads, %llu torn\n", (unsigned long long)tally->sets,
		      (unsigned long long)tally->reads, (unsigned long long)tally->torn);
}

static struct tally *tally_map(void)
{
	struct tally *tally = mmap(NULL, sizeof(*tally), PROT_READ | PROT_WRITE,
				   MAP_SHARED | MAP_ANONYMOUS, -1, 0);

	assert_ptr_not_equal(tally, MAP_FAILED);
	return tally;
}

static void a_reader_that_keeps_the_rule_never_sees_another_node(void **state)
{
	struct tally *tally = tally_map();

	run_readers(*state, true, tally);
	assert_int_equal(tally->torn, 0);
	(void)munmap(tally, sizeof(*tally));
}

static void a_reader_that_trusts_the_word_alone_is_caught(void **state)
{
	struct tally *tally = tally_map();

	run_readers(*state, false, tally);
	assert_true(tally->torn > 0);
	(void)munmap(tally, sizeof(*tally));
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test_setup_teardown(
			a_reader_that_keeps_the_rule_never_sees_another_node, test_folder_setup,
			test_folder_teardown),
		cmocka_unit_test_setup_teardown(a_reader_that_trusts_the_word_alone_is_caught,
						test_folder_setup, test_folder_teardown),
	};

	return TEST_RUN(tests);
}
