/* SPDX-License-Identifier: MIT */
/**
 * budget.h - one bound of memory for the whole build.
 *
 * Whoever keeps bytes for long takes them from the budget first and gives them back when they are
 * freed.  What can wait on disk is refused when the budget is spent (budget_take); what cannot,
 * such as tables that grow with the model, is charged whatever is left (budget_charge), so that the
 * others get less.
 *
 * Threads: any.
 */
#ifndef TOOLS_BUILD_BUDGET_H
#define TOOLS_BUILD_BUDGET_H

#include <stdatomic.h>
#include <stdbool.h>
#include <stdint.h>

struct budget {
	uint64_t limit_bytes;
	_Atomic uint64_t taken_bytes;
};

static inline void budget_init(struct budget *budget, uint64_t limit_bytes)
{
	budget->limit_bytes = limit_bytes;
	atomic_init(&budget->taken_bytes, 0);
}

/** Takes bytes if they are there. */
static inline bool budget_take(struct budget *budget, uint64_t bytes)
{
	uint64_t taken = atomic_load(&budget->taken_bytes);

	do {
		if (taken > budget->limit_bytes || bytes > budget->limit_bytes - taken)
			return false;
	} while (!atomic_compare_exchange_weak(&budget->taken_bytes, &taken, taken + bytes));
	return true;
}

/** Takes bytes that cannot be done without. */
static inline void budget_charge(struct budget *budget, uint64_t bytes)
{
	atomic_fetch_add(&budget->taken_bytes, bytes);
}

static inline void budget_give(struct budget *budget, uint64_t bytes)
{
	atomic_fetch_sub(&budget->taken_bytes, bytes);
}

static inline uint64_t budget_left(const struct budget *budget)
{
	uint64_t taken = atomic_load(&budget->taken_bytes);

	return taken < budget->limit_bytes ? budget->limit_bytes - taken : 0;
}

#endif /* TOOLS_BUILD_BUDGET_H */
