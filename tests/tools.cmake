# SPDX-License-Identifier: MIT
oocd_test(test_gen_mesh unit
	SOURCES unit/test_gen_mesh.c unit/ply_mesh.c LINK oocd_gen oocd_test_helper)
oocd_test(test_rack_place unit
	SOURCES unit/test_rack_place.c unit/ply_mesh.c LINK oocd_gen oocd_test_helper)
oocd_test(test_oocgen integration
	SOURCES integration/test_oocgen.c LINK oocd_gen oocd_test_helper TIMEOUT 120)
add_dependencies(test_oocgen oocgen)
oocd_test(test_flip unit SOURCES unit/test_flip.c LINK oocd_bench oocd_test_helper)
oocd_test(test_plot unit SOURCES unit/test_plot.c LINK oocd_bench oocd_test_helper)
oocd_test(test_walk integration
	SOURCES integration/test_walk.c LINK oocd_test_helper PkgConfig::JANSSON
	TIMEOUT 120 NEEDS oocbench oocbuild oocd oocgen)
oocd_test(test_figures unit SOURCES unit/test_figures.c LINK oocd_bench oocd_test_helper)
oocd_test(test_pareto unit SOURCES unit/test_pareto.c LINK oocd_bench oocd_test_helper)
oocd_test(test_rgb_image unit SOURCES unit/test_rgb_image.c LINK oocd_bench oocd_test_helper)
oocd_test(test_page unit SOURCES unit/test_page.c LINK oocd_bench oocd_test_helper)
oocd_test(test_chart integration
	SOURCES integration/test_chart.c LINK oocd_test_helper
	TIMEOUT 120 SKIPS_TSAN NEEDS oocbench oocbuild oocd oocgen oocview)
