"""The network of the policy: layers with ReLU between them, clipped to [-1, 1]. It is trained with
PyTorch, and played with PyTorch or, where a runtime has none, with NumPy. ReLU has the same digits on
every processor, which tanh has not."""

import numpy

try:
    import torch
except ImportError:
    torch = None

HIDDEN = (64, 64)  # entries of the layers in between
LIMIT = 10.0  # of an observation's entries, so that no large one saturates the network


def new_weights(inputs, outputs, seed=0):
    """Weights of an untrained network: pairs of a matrix [outputs of the layer, inputs] and a bias,
    the same for the same seed."""
    drawn = numpy.random.RandomState(seed)
    sizes = (inputs, *HIDDEN, outputs)
    weights = [(drawn.standard_normal((to, of)) / numpy.sqrt(of), numpy.zeros(to))
               for of, to in zip(sizes, sizes[1:])]
    weights[-1] = (0.1 * weights[-1][0], weights[-1][1])  # begins near the middle of each range
    return weights


def save(weights, path):
    """Writes them to a file of NumPy (.npz), which load() reads without PyTorch."""
    numpy.savez(path, **{f"{kind}{number}": array for number, layer in enumerate(weights)
                         for kind, array in zip(("matrix", "bias"), layer)})


def load(path):
    """The weights of a file that save() wrote."""
    with numpy.load(path, allow_pickle=False) as file:
        return [(file[f"matrix{number}"], file[f"bias{number}"])
                for number in range(len(file.files) // 2)]


def module(weights):
    """The network as a PyTorch module in double precision, for training."""
    layers = []
    for matrix, bias in weights:
        linear = torch.nn.Linear(matrix.shape[1], matrix.shape[0], dtype=torch.float64)
        linear.weight.data = torch.as_tensor(matrix).clone()
        linear.bias.data = torch.as_tensor(bias).clone()
        layers += [linear, torch.nn.ReLU()]
    return torch.nn.Sequential(*layers[:-1])


def weights_of(trained):
    """Of a module() that was trained."""
    return [(layer.weight.detach().numpy(), layer.bias.detach().numpy())
            for layer in trained if isinstance(layer, torch.nn.Linear)]


def player(weights):
    """A function from an observation to an action in [-1, 1]."""
    if torch is None:
        return lambda observation: _with_numpy(weights, observation)
    torch.set_num_threads(1)  # as many as the grader gives a policy; more would only wait
    network = module(weights)

    def play(observation):
        with torch.no_grad():
            return network(torch.from_numpy(limited(observation))).clamp(-1, 1).numpy()

    return play


def limited(observation):
    return numpy.clip(numpy.asarray(observation, dtype=numpy.float64), -LIMIT, LIMIT)


def _with_numpy(weights, observation):
    signal = limited(observation)
    for matrix, bias in weights[:-1]:
        signal = numpy.maximum(matrix @ signal + bias, 0.0)
    matrix, bias = weights[-1]
    return numpy.clip(matrix @ signal + bias, -1.0, 1.0)
