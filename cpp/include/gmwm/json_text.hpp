// The text of JSON documents, which are too large to be indented in Python.
#pragma once

#include <string>
#include <string_view>

namespace gmwm {

// The text of valid JSON without white space after commas, with each item of a container on a line of its own, indented
// by one space for each container around it; empty containers stay as they are.
std::string indented(std::string_view json);

}  // namespace gmwm
