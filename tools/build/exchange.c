/* SPDX-License-Identifier: MIT */
#include "tools/build/exchange.h"

#include <errno.h>
#include <pthread.h>
#include <stdbool.h>
#include <stdlib.h>
#include <string.h>

#include "formats/base/bytes.h"
#include "formats/base/check.h"

struct exchange {
	struct spool *spool;
	struct budget *budget;
	uint32_t destination_count;
	bool sealed;
	pthread_mutex_t lock; /* of the fragments, until they are sealed */
	struct exchange_fragment *fragments;
	size_t fragment_count;
	size_t fragment_max;
	size_t *first; /* of each destination, and one past the last */
};

int exchange_create(struct spool *spool, struct budget *budget, uint32_t destination_count,
		    struct exchange **ret)
{
	struct exchange *exchange = calloc(1, sizeof(*exchange));

	if (!exchange)
		return -ENOMEM;
	exchange->spool = spool;
	exchange->budget = budget;
	exchange->destination_count = destination_count;
	(void)pthread_mutex_init(&exchange->lock, NULL);
	*ret = exchange;
	return 0;
}

struct exchange *exchange_destroy(struct exchange *exchange)
{
	if (!exchange)
		return NULL;
	budget_give(exchange->budget, exchange->fragment_max * sizeof(*exchange->fragments));
	(void)pthread_mutex_destroy(&exchange->lock);
	free(exchange->fragments);
	free(exchange->first);
	free(exchange);
	return NULL;
}

/* Makes room in the table.  The lock is held. */
static int table_grow(struct exchange *exchange, size_t more)
{
	size_t needed = exchange->fragment_count + more;
	size_t fragment_max = u64_max(exchange->fragment_max * 3 / 2, needed);
	struct exchange_fragment *fragments;

	if (needed <= exchange->fragment_max)
		return 0;
	fragments = reallocarray(exchange->fragments, fragment_max, sizeof(*fragments));
	if (!fragments)
		return -ENOMEM;
	budget_charge(exchange->budget,
		      (fragment_max - exchange->fragment_max) * sizeof(*fragments));
	exchange->fragments = fragments;
	exchange->fragment_max = fragment_max;
	return 0;
}

int exchange_put(struct exchange *exchange, uint64_t origin, const void *data,
		 struct exchange_fragment *fragments, size_t fragment_count, struct why *why)
{
	uint64_t bytes = 0;
	uint64_t address;
	int r;

	CHECK(!exchange->sealed);
	for (size_t i = 0; i < fragment_count; i++) {
		CHECK(fragments[i].destination < exchange->destination_count);
		fragments[i].origin = origin;
		bytes += fragments[i].bytes;
	}
	if (bytes == 0)
		return 0;
	r = spool_append(exchange->spool, data, bytes, &address, why);
	if (r < 0)
		return r;
	for (size_t i = 0; i < fragment_count; i++) {
		fragments[i].address = address;
		address += fragments[i].bytes;
	}
	(void)pthread_mutex_lock(&exchange->lock);
	r = table_grow(exchange, fragment_count);
	if (r == 0) {
		memcpy(exchange->fragments + exchange->fragment_count, fragments,
		       fragment_count * sizeof(*fragments));
		exchange->fragment_count += fragment_count;
	}
	(void)pthread_mutex_unlock(&exchange->lock);
	return r == 0 ? 0 : why_set(why, r, "no memory for the table of fragments");
}

static int compare_fragments(const void *a, const void *b)
{
	const struct exchange_fragment *left = a;
	const struct exchange_fragment *right = b;

	if (left->destination != right->destination)
		return left->destination < right->destination ? -1 : 1;
	if (left->origin != right->origin)
		return left->origin < right->origin ? -1 : 1;
	/* One origin is one thread's: its pieces were put one after the other. */
	return (left->address > right->address) - (left->address < right->address);
}

int exchange_seal(struct exchange *exchange, struct why *why)
{
	size_t fragment = 0;

	CHECK(!exchange->sealed);
	exchange->first = calloc((size_t)exchange->destination_count + 1, sizeof(size_t));
	if (!exchange->first)
		return why_set(why, -ENOMEM, "no memory for the table of fragments");
	if (exchange->fragment_count > 1)
		qsort(exchange->fragments, exchange->fragment_count, sizeof(*exchange->fragments),
		      compare_fragments);
	for (uint32_t i = 0; i < exchange->destination_count; i++) {
		exchange->first[i] = fragment;
		while (fragment < exchange->fragment_count &&
		       exchange->fragments[fragment].destination == i)
			fragment++;
	}
	exchange->first[exchange->destination_count] = fragment;
	exchange->sealed = true;
	return 0;
}

const struct exchange_fragment *exchange_fragments(const struct exchange *exchange,
						   uint32_t destination, size_t *ret_count)
{
	CHECK(exchange->sealed && destination < exchange->destination_count);
	*ret_count = exchange->first[destination + 1] - exchange->first[destination];
	return exchange->fragments + exchange->first[destination];
}

uint64_t exchange_bytes(const struct exchange *exchange, uint32_t destination)
{
	size_t count;
	const struct exchange_fragment *fragments =
		exchange_fragments(exchange, destination, &count);
	uint64_t bytes = 0;

	for (size_t i = 0; i < count; i++)
		bytes += fragments[i].bytes;
	return bytes;
}

int exchange_read(const struct exchange *exchange, uint32_t destination, uint64_t begin, void *data,
		  uint64_t bytes, struct why *why)
{
	size_t count;
	const struct exchange_fragment *fragments =
		exchange_fragments(exchange, destination, &count);
	uint8_t *to = data;

	for (size_t i = 0; i < count && bytes > 0; i++) {
		uint64_t here;
		int r;

		if (begin >= fragments[i].bytes) {
			begin -= fragments[i].bytes;
			continue;
		}
		here = u64_min(fragments[i].bytes - begin, bytes);
		r = spool_read(exchange->spool, fragments[i].address + begin, to, here, why);
		if (r < 0)
			return r;
		to += here;
		bytes -= here;
		begin = 0;
	}
	CHECK(bytes == 0);
	return 0;
}
