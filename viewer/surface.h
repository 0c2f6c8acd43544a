/* SPDX-License-Identifier: MIT */
/**
 * surface.h - where OpenGL 4.5 comes from: a window, or nowhere at all.
 *
 * Both kinds give a current core context with the state that all of the viewer relies on:
 * reversed-Z (clip depth 0..1, greater is nearer, cleared to 0), rows without padding.  Pictures are
 * drawn into targets (target.h) either way; a window only shows them.
 *
 * Threads: one surface a process, used by the thread that opened it.
 */
#ifndef VIEWER_SURFACE_H
#define VIEWER_SURFACE_H

#include <stdint.h>

#include "formats/base/why.h"

struct GLFWwindow;
struct surface;

/**
 * Opens a window.  The context is made through EGL, as the headless one.
 *
 * Returns: 0, or -ENODEV with what is missing: no display, no OpenGL 4.5.
 */
int surface_open_window(const char *title, uint32_t width, uint32_t height, struct surface **ret,
			struct why *why);

/** Opens a context without any surface.  Returns: 0, or -ENODEV. */
int surface_open_headless(struct surface **ret, struct why *why);

/** NULL is allowed.  Returns: NULL. */
struct surface *surface_close(struct surface *surface);

/** The window, or NULL when headless. */
struct GLFWwindow *surface_window(const struct surface *surface);

/** "llvmpipe (LLVM 15.0.6, 256 bits)". */
const char *surface_renderer(const struct surface *surface);

#endif /* VIEWER_SURFACE_H */
