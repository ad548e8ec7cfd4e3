# The Debian packages that scripts/package makes. What goes into which is said where it is installed, by component: ros, tools
# (no ROS in it), lab.

# Names of a group of scripts/packages.txt, separated by commas.
function(packages_of group variable)
  file(STRINGS ${PROJECT_SOURCE_DIR}/scripts/packages.txt lines)
  foreach(line IN LISTS lines)
    if(line MATCHES "^# .([a-z]+).$")
      set(current ${CMAKE_MATCH_1})
    elseif(line MATCHES "^([a-z][^ ]*)" AND current STREQUAL group)
      list(APPEND names ${CMAKE_MATCH_1})
    endif()
  endforeach()
  list(JOIN names ", " names)
  set(${variable} ${names} PARENT_SCOPE)
endfunction()
packages_of(run run_packages)
packages_of(lab lab_packages)

install(SCRIPT cmake/link_tools.cmake COMPONENT tools)

set(CPACK_GENERATOR DEB)
set(CPACK_DEB_COMPONENT_INSTALL ON)
set(CPACK_COMPONENTS_ALL tools ros)
set(CPACK_SET_DESTDIR ON) # the Python part is installed by setup.py, which knows no other way
set(CPACK_INSTALL_PREFIX ${CMAKE_INSTALL_PREFIX})
set(CPACK_PACKAGE_VERSION ${${PROJECT_NAME}_VERSION})
set(CPACK_DEBIAN_PACKAGE_MAINTAINER "all_in_focus contributors <all-in-focus@users.noreply.github.com>")
set(CPACK_DEBIAN_FILE_NAME DEB-DEFAULT)
set(CPACK_STRIP_FILES ON)
set(CPACK_DEBIAN_PACKAGE_SHLIBDEPS ON) # libraries by what the programs are linked with
set(CPACK_DEBIAN_PACKAGE_SHLIBDEPS_PRIVATE_DIRS ${CATKIN_DEVEL_PREFIX}/lib)

set(CPACK_DEBIAN_TOOLS_PACKAGE_NAME all-in-focus-tools)
set(CPACK_DEBIAN_TOOLS_PACKAGE_SECTION graphics)
set(CPACK_COMPONENT_TOOLS_DESCRIPTION "All-in-focus pictures from focus brackets
fuse_stack makes one picture, in which everything is sharp, of photographs that
are focused at different distances. A depth map helps where there is one.")

set(CPACK_DEBIAN_ROS_PACKAGE_NAME ros-all-in-focus)
set(CPACK_DEBIAN_ROS_PACKAGE_SECTION science)
set(CPACK_DEBIAN_ROS_PACKAGE_DEPENDS "all-in-focus-tools (= ${CPACK_PACKAGE_VERSION}), ${run_packages}")
set(CPACK_DEBIAN_ROS_PACKAGE_RECOMMENDS rviz)
set(CPACK_COMPONENT_ROS_DESCRIPTION "All-in-focus pictures from a camera and a depth sensor, for ROS
Nodes for a colour camera that sweeps its focus and a depth sensor beside it,
and programs for their calibration and for bags.")

set(CPACK_DEBIAN_LAB_PACKAGE_NAME all-in-focus-lab)
set(CPACK_DEBIAN_LAB_PACKAGE_SECTION science)
set(CPACK_DEBIAN_LAB_PACKAGE_ARCHITECTURE all)
set(CPACK_DEBIAN_LAB_PACKAGE_SHLIBDEPS OFF)
set(CPACK_DEBIAN_LAB_PACKAGE_DEPENDS "ros-all-in-focus (= ${CPACK_PACKAGE_VERSION}), ${lab_packages}")
set(CPACK_COMPONENT_LAB_DESCRIPTION "Laboratory of all_in_focus
Scenes of known truth, fusion methods of others, metrics, the benchmark.")
if(ALL_IN_FOCUS_LAB)
  list(APPEND CPACK_COMPONENTS_ALL lab)
endif()

configure_file(LICENSE ${CMAKE_BINARY_DIR}/copyright COPYONLY)
foreach(component IN LISTS CPACK_COMPONENTS_ALL)
  string(TOUPPER ${component} name)
  install(FILES ${CMAKE_BINARY_DIR}/copyright DESTINATION share/doc/${CPACK_DEBIAN_${name}_PACKAGE_NAME} COMPONENT ${component})
endforeach()
include(CPack)
