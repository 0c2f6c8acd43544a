# SPDX-License-Identifier: MIT
oocd_test(test_camera unit SOURCES unit/test_camera.c LINK oocd_select oocd_test_helper m)
oocd_test(test_birds_eye unit SOURCES unit/test_birds_eye.c LINK oocd_select oocd_test_helper m)
oocd_test(test_motion unit SOURCES unit/test_motion.c LINK oocd_select oocd_test_helper m)
oocd_test(test_select unit SOURCES unit/test_select.c LINK oocd_select oocd_test_helper m SKIPS_TSAN)
oocd_test(test_raster unit SOURCES unit/test_raster.c LINK oocd_select oocd_test_helper m SKIPS_TSAN)
oocd_test(test_raster_gl integration
	SOURCES integration/test_raster_gl.c
	LINK oocd_select PkgConfig::EPOXY PkgConfig::EGL m SKIPS_TSAN)
oocd_test(test_bench integration
	SOURCES integration/test_bench.c
	LINK oocd_bench oocd_test_helper m
	TIMEOUT 300 SKIPS_TSAN
	NEEDS oocbench oocbuild oocd oocgen oocview)
oocd_test(test_conservative unit
	SOURCES unit/test_conservative.c helper_scene.c
	LINK oocd_select oocd_store oocd_test_helper m SKIPS_TSAN)
oocd_test(test_occlusion unit
	SOURCES unit/test_occlusion.c LINK oocd_select oocd_test_helper m)
oocd_test(test_tight_boxes unit
	SOURCES unit/test_tight_boxes.c LINK oocd_select oocd_store oocd_test_helper)
oocd_test(test_select_orders unit
	SOURCES unit/test_select_orders.c helper_scene.c
	LINK oocd_select oocd_store oocd_test_helper m SKIPS_TSAN)
