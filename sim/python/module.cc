// The extension module myograde._env: the simulator's environments for Python.
#include "sim/python/bindings.h"

NB_MODULE(_env, module) {
  module.doc() = "The simulator's environments; myograde.envs is the interface for people.";
  // Processes that libraries of training start end without freeing every environment.
  nanobind::set_leak_warnings(false);
  myograde::sim::BindHost(module);
  myograde::sim::BindEnvironment(module);
  myograde::sim::BindRender(module);
  myograde::sim::BindVectorEnvironment(module);
}
