#include <nanobind/nanobind.h>

#include <string>

#include "gmwm/json_text.hpp"

namespace nb = nanobind;
using namespace nb::literals;

namespace {

nb::bytes indented(const nb::bytes& json) {
  const std::string text = gmwm::indented({json.c_str(), json.size()});
  return nb::bytes(text.data(), text.size());
}

}  // namespace

void bind_json_text(nb::module_& m) {
  m.def("indented", &indented, "json"_a,
        "Return JSON without white space after commas with each item of a container on its own line, indented.");
}
