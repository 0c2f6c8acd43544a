# SPDX-License-Identifier: MIT
oocd_test(test_raster_gl integration
	SOURCES integration/test_raster_gl.c
	LINK oocd_select oocd_base PkgConfig::EPOXY PkgConfig::EGL m)
