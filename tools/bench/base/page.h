/* SPDX-License-Identifier: MIT */
/**
 * page.h - a report as one HTML file that stands alone: text, tables, plots and pictures inside.
 *
 * What cannot be written is told by page_finish(), which gives the file its name.
 *
 * Threads: one.
 */
#ifndef TOOLS_BENCH_BASE_PAGE_H
#define TOOLS_BENCH_BASE_PAGE_H

#include <stdbool.h>

#include "formats/base/why.h"
#include "tools/bench/base/rgb_image.h"

struct page;

/** Begins a page.  Returns: 0, -ENOMEM or -errno.  Ownership: page_finish() or page_abandon(). */
int page_create(const char *path, const char *title, struct page **ret, struct why *why);

/** All is written.  Ends the page, whatever it returns: 0 or -errno. */
int page_finish(struct page *page, struct why *why);
/** Ends it without a file.  NULL is allowed.  Returns: NULL. */
struct page *page_abandon(struct page *page);

void page_heading(struct page *page, const char *text);
void page_paragraph(struct page *page, const char *format, ...)
	__attribute__((format(printf, 2, 3)));

/** heads: NULL-terminated, as are cells. */
void page_table_begin(struct page *page, const char *const *heads);
/** is_marked: in bold. */
void page_row(struct page *page, const char *const *cells, bool is_marked);
void page_table_end(struct page *page);

/** Takes an SVG file in as it is.  Returns: 0 or -errno. */
int page_svg(struct page *page, const char *path, struct why *why);

/** A picture with a line below; several in a row stand side by side.  Returns: 0 or -ENOMEM. */
int page_image(struct page *page, const struct rgb_image *image, const char *caption);

#endif /* TOOLS_BENCH_BASE_PAGE_H */
