// SPDX-License-Identifier: MIT
//
// ooc_stream - walks through all of a store in portions that are smaller than the cache.
//
//	ooc_stream STORE.ooc [PORTION_MIB]
//
//	c++ -std=c++17 ooc_stream.cpp $(pkg-config --cflags --libs oocclient) -o ooc_stream
//
// A program that needs all the geometry once (to print it, to measure it, to make a film of a view
// that is larger than memory) does not load it: it holds a portion, works on it, and lets go of it by
// wanting the next.  While it works, the portion after that is being read: that is what ooc_prefetch()
// is for.  Memory stays bounded by the daemon's cache, and is shared with whoever else looks at the
// store.
//
// Nodes are taken in the order of the file, so the disk is read once from front to back.

#include <algorithm>
#include <cerrno>
#include <cstdio>
#include <cstdlib>
#include <memory>
#include <stdexcept>
#include <string>
#include <vector>

#include <ooc/client.h>

namespace
{

struct client_deleter {
	void operator()(ooc_client *client) const
	{
		ooc_disconnect(client);
	}
};
using client_ptr = std::unique_ptr<ooc_client, client_deleter>;

struct totals {
	unsigned long long nodes = 0;
	unsigned long long triangles = 0;
	unsigned long long bytes = 0;
	unsigned long long portions = 0;
	unsigned long long unreadable = 0;
};

client_ptr connect()
{
	ooc_client *client = nullptr;

	if (ooc_connect(nullptr, "ooc_stream", &client) < 0)
		throw std::runtime_error(ooc_error_text(nullptr));
	return client_ptr(client);
}

// All nodes with geometry of the finest level, in the order in which they lie on disk.
std::vector<ooc_want> leaves_of(ooc_store *store)
{
	const store_node *nodes = ooc_nodes(store);
	std::vector<ooc_want> wants;

	for (uint32_t i = 0; i < ooc_node_count(store); i++) {
		if (nodes[i].child_count == 0 && nodes[i].payload_bytes > 0)
			wants.push_back({ store, i, 1.0f });
	}
	std::sort(wants.begin(), wants.end(), [nodes](const ooc_want &a, const ooc_want &b) {
		return nodes[a.node].file_offset < nodes[b.node].file_offset;
	});
	return wants;
}

// How many of the wants from `begin` on make a portion; at least one.
size_t portion_size(const std::vector<ooc_want> &wants, size_t begin, uint64_t portion_bytes)
{
	const store_node *nodes = ooc_nodes(wants[begin].store);
	uint64_t bytes = 0;
	size_t end = begin;

	while (end < wants.size() && (end == begin || bytes < portion_bytes))
		bytes += nodes[wants[end++].node].payload_bytes;
	return end - begin;
}

// What a program is here for: this one adds up.  The pointer is good until the next set.
void work_on(const void *payload, totals &sum)
{
	const auto *header = static_cast<const payload_header *>(payload);

	sum.nodes++;
	sum.triangles += header->triangle_count;
	sum.bytes += header->payload_bytes;
}

// Returns how many of the portion were worked on: what did not fit is for the next one.
size_t portion_work(ooc_client *client, const ooc_want *wants, size_t count, totals &sum)
{
	size_t done = 0;

	if (ooc_visible_set(client, wants, count) < 0)
		throw std::runtime_error(ooc_error_text(client));
	if (int r = ooc_wait(client, 60000); r < 0)
		throw std::runtime_error(r == -ETIMEDOUT ? "the daemon does not get on"
							 : ooc_error_text(client));
	for (; done < count; done++) {
		const void *payload = ooc_map(wants[done].store, wants[done].node);

		if (payload)
			work_on(payload, sum);
		else if (ooc_not_now(wants[done].store, wants[done].node) == OOC_REASON_FULL)
			break;
		else
			sum.unreadable++;
	}
	sum.portions++;
	return done;
}

totals stream(ooc_client *client, ooc_store *store, uint64_t portion_bytes)
{
	const std::vector<ooc_want> wants = leaves_of(store);
	totals sum;

	for (size_t begin = 0; begin < wants.size();) {
		size_t count = portion_size(wants, begin, portion_bytes);
		size_t next = begin + count;

		// The disk is busy with the next portion while we are busy with this one.
		if (next < wants.size())
			ooc_prefetch(client, &wants[next],
				     portion_size(wants, next, portion_bytes));
		size_t done = portion_work(client, &wants[begin], count, sum);
		if (done == 0)
			throw std::runtime_error("not one node of a portion fits into the cache");
		begin += done;
	}
	return sum;
}

} // namespace

int main(int argc, char **argv)
{
	if (argc < 2 || argc > 3) {
		std::fprintf(stderr, "Usage: ooc_stream STORE.ooc [PORTION_MIB]\n");
		return 2;
	}
	try {
		const uint64_t portion_mib = argc > 2 ? std::strtoull(argv[2], nullptr, 10) : 16;
		client_ptr client = connect();
		ooc_store *store = nullptr;

		if (ooc_open(client.get(), argv[1], &store) < 0)
			throw std::runtime_error(ooc_error_text(client.get()));
		const totals sum = stream(client.get(), store, portion_mib << 20);
		std::printf("%llu triangles in %llu nodes, %llu bytes, %llu portions\n",
			    sum.triangles, sum.nodes, sum.bytes, sum.portions);
		return sum.unreadable > 0 ? 1 : 0;
	} catch (const std::exception &error) {
		std::fprintf(stderr, "ooc_stream: %s: %s\n", argv[1], error.what());
		return 1;
	}
}
