"""What a game engine does with a worker's `engine` and `kernel` messages, line by line, in NumPy (docs/engine.md).

    python examples/engine_consumer.py tcp://127.0.0.1:PORT perceived.png --scene scene.exr --fov 104

A scene is linear RGB in cd/m² (.exr or .hdr); without one, a lamp in a dark room. Each function is one pass.
"""

import argparse

import msgpack
import numpy as np
import OpenImageIO as oiio
import zmq

LUMINANCE = np.array([0.2126, 0.7152, 0.0722])  # of linear Rec.709
OKLAB_LMS = np.array(  # Ottosson 2020
    [
        [0.4122214708, 0.5363325363, 0.0514459929],
        [0.2119034982, 0.6806995451, 0.1073969566],
        [0.0883024619, 0.2817188376, 0.6299787005],
    ]
)
OKLAB_AB = np.array([[1.9779984951, -2.4285922050, 0.4505937099], [0.0259040371, 0.7827717662, -0.8086757660]])
TILE_DEG = 2.0  # the veil is smooth: tiles of this side are enough


def receive(address, patience_ms=60_000):
    """One frame's `engine` message, and of each eye the kernel that it names."""
    socket = zmq.Context.instance().socket(zmq.SUB)
    socket.connect(address)
    for topic in (b"engine", b"kernel"):
        socket.subscribe(topic)
    kernels = {}
    while socket.poll(patience_ms):
        topic, message = socket.recv_multipart()
        body = msgpack.unpackb(message)["body"]
        if topic == b"kernel":
            kernels[body["number"]] = body
        elif all(eye["kernel"] in (0, *kernels) for eye in body["eyes"]):
            return body, kernels
    raise SystemExit(f"nothing from {address}: give the address that the worker logs as `frames`")


def convolve(light, kernel):
    """Each pixel's light laid around it; what falls beyond the frame is lost. An engine has an FFT pass for it."""
    halves = np.frombuffer(kernel["rgb"], "<f2").reshape(kernel["side"], kernel["side"], 3)
    around = halves.astype(np.float64) * kernel["scale"]
    size = [pixels + kernel["side"] - 1 for pixels in light.shape[:2]]
    spectrum = np.fft.rfft2(light, size, axes=(0, 1)) * np.fft.rfft2(around, size, axes=(0, 1))
    top = left = kernel["side"] // 2
    return np.fft.irfft2(spectrum, size, axes=(0, 1))[top : top + light.shape[0], left : left + light.shape[1]]


def veil(light, kernel, focal_px):
    """Light that goes farther than the kernel reaches, from tile to tile at true angles; then enlarged linearly."""
    height, width, _ = light.shape
    tile = max(round(TILE_DEG * kernel["pixels_per_deg"]), 1)
    padded = np.pad(light, ((0, -height % tile), (0, -width % tile), (0, 0)))
    tiles = padded.reshape(padded.shape[0] // tile, tile, padded.shape[1] // tile, tile, 3).sum(axis=(1, 3))
    down, right = ((np.arange(n) + 0.5) * tile for n in tiles.shape[:2])
    v, u = np.meshgrid((down - height / 2) / focal_px, (right - width / 2) / focal_px, indexing="ij")
    ahead = 1 / np.sqrt(1 + u * u + v * v)
    directions = np.stack([u * ahead, v * ahead, ahead], -1).reshape(-1, 3)
    steradians = ahead.reshape(-1, 1) ** 3 / focal_px**2
    degrees = np.degrees(np.arccos(np.clip(directions @ directions.T, -1, 1)))
    per_sr = np.interp(degrees, kernel["veil_deg"], kernel["veil_per_sr"], left=0, right=0)
    arrives = (per_sr @ (tiles.reshape(-1, 3) * steradians)).reshape(tiles.shape)
    rows, columns = (
        np.stack([np.interp(np.arange(n) + 0.5, at, one) for one in np.eye(len(at))], axis=1)
        for n, at in ((height, down), (width, right))
    )
    return np.einsum("yv,vuc,xu->yxc", rows, arrives, columns, optimize=True)


def glare(light, eye, kernel, focal_px):
    """Light that the eye scatters. None is made: what a pixel gives away is what others get."""
    scattering = light
    if eye["glare_ceiling_cd_m2"] is not None:
        ceiling = eye["glare_ceiling_cd_m2"]
        scattering = light * (1 - ceiling / np.maximum(light @ LUMINANCE, ceiling))[..., None]
    given_away = (np.array(kernel["stays_rgb"]) + kernel["veil_share"] - 1) * scattering
    change = given_away + convolve(scattering, kernel)
    if kernel["veil_deg"]:
        change = change + veil(scattering, kernel, focal_px) - kernel["veil_share"] * scattering
    return light + eye["glare_weight"] * change


def acuity(light, eye):
    """Dark parts lose detail: L* is blurred along rows, then columns, each with its own σ. L* is CIELAB's."""
    luminance = np.maximum(light @ LUMINANCE, 0)
    sharp = blurred = np.where(luminance > 0.8856, 116 * np.cbrt(luminance / 100) - 16, luminance * 243.89 / 27)
    fit = eye["acuity"] == "fit"
    reach = 3 if fit else int(np.ceil(3 * eye["acuity_sigma_px"]))
    for axis in (1, 0):
        sigma = np.maximum(1 - blurred, 0) if fit else np.full_like(blurred, eye["acuity_sigma_px"])
        near = np.pad(blurred, [(reach, reach) if a == axis else (0, 0) for a in (0, 1)], mode="edge")
        taps = [np.exp(-(k * k) / (2 * np.maximum(sigma**2, 0.02))) for k in range(-reach, reach + 1)]
        parts = [tap * np.take(near, k + np.arange(blurred.shape[axis]), axis) for k, tap in enumerate(taps)]
        blurred = sum(parts) / sum(taps)
    back = 100 * np.where(blurred > 8, ((blurred + 16) / 116) ** 3, blurred * 27 / 24389)
    change = np.where(sharp < 1, back - luminance, 0) if fit else back - luminance
    return np.maximum(light + eye["acuity_weight"] * change[..., None], np.minimum(light, 0))


def to_white(rgb):
    """What is beyond the display keeps Oklab's hue: at some angle around grey, and is dimmed."""
    y = np.minimum(rgb @ LUMINANCE, 1)[..., None]
    with np.errstate(divide="ignore", invalid="ignore"):
        way = np.fmax((rgb.max(-1, keepdims=True) - y) / (1 - y), (y - rgb.min(-1, keepdims=True)) / y)[..., 0]
    beyond = (way > 1.01) & (y[..., 0] > 0)
    out = np.where(beyond[..., None] & (y >= 1), 1, np.clip(rgb, 0, 1)) * (y > 0)
    beyond &= y[..., 0] < 1
    colour, y, share = rgb[beyond], y[beyond], np.clip((way[beyond, None] - 1.01) * 20, 0, 1)
    y = y * np.maximum(colour.max(1, keepdims=True), 1) ** (-0.75 * (1 - y))
    from_grey = colour / (colour @ LUMINANCE)[:, None] - 1
    across = np.cross(LUMINANCE, from_grey)
    across *= np.linalg.norm(from_grey, axis=1, keepdims=True) / np.linalg.norm(across, axis=1, keepdims=True)

    def edge(angle):
        step = np.cos(angle) * from_grey + np.sin(angle) * across
        return y + step / np.maximum(step.max(1, keepdims=True) / (1 - y), -step.min(1, keepdims=True) / y)

    def turned(angle):
        """Positive where the hue at that angle lies on the far side of the colour's own."""
        (a, b), (c, d) = (OKLAB_AB @ np.cbrt(OKLAB_LMS @ one.T) for one in (edge(angle), colour))
        return (a * d - b * c)[:, None]

    low, high = np.full_like(y, -1), np.full_like(y, 1)
    sense = np.sign(turned(high))
    for _ in range(16):
        middle = (low + high) / 2
        past = sense * turned(middle) > 0
        low, high = np.where(past, low, middle), np.where(past, middle, high)
    out[beyond] += share * (np.clip(edge(low), 0, 1) - out[beyond])
    return out


def within_peak(rgb):
    """What a tint brings above the peak is mixed with white of its luminance."""
    y, most = np.minimum(rgb @ LUMINANCE, 1)[..., None], rgb.max(-1, keepdims=True)
    return y + (rgb - y) * np.where(most > 1, (1 - y) / np.maximum(most - y, 1e-9), 1)


def shown(light, eye, black_share):
    """The filmic curve of luminance, to white what is beyond the display, towards the rods' grey, sRGB code values."""
    if (eye["tone"], eye["hue"]) != ("aces", "oklab"):
        raise SystemExit(f"this example shows tone `aces` with hue `oklab`, not {eye['tone']} with {eye['hue']}")
    x = np.clip(light @ LUMINANCE * eye["exposure"], 1e-30, 1e4)
    curve = np.minimum(x * (2.51 * x + 0.03) / (x * (2.43 * x + 0.59) + 0.14), 1)
    rgb = to_white(light * (curve / x * eye["exposure"])[..., None])
    grey = (rgb @ np.array(eye["rod_weights"]))[..., None] * np.array(eye["tint_rgb"])
    rgb = within_peak(rgb + eye["tint_share"] * (grey - rgb))
    share = np.clip((rgb - black_share) / (1 - black_share), 0, 1)
    return np.round(255 * np.where(share <= 0.0031308, 12.92 * share, 1.055 * share ** (1 / 2.4) - 0.055)).astype("u1")


def post_process(light, eye, kernel, black_share, fov_deg):
    """All passes: cd/m² in, code values out."""
    focal_px = light.shape[1] / 2 / np.tan(np.radians(fov_deg) / 2)
    if eye["kernel"]:
        light = glare(light, eye, kernel, focal_px)
    if eye["acuity_weight"]:
        light = acuity(light, eye)
    return shown(light, eye, black_share)


if __name__ == "__main__":
    options = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    options.add_argument("address")
    options.add_argument("out")
    options.add_argument("--scene")
    options.add_argument("--fov", type=float, default=104.0, help="horizontal field of view, degrees")
    given = options.parse_args()
    scene = np.full((480, 480, 3), 0.05)
    scene[160:164, 120:124] = (40_000, 30_000, 15_000)
    scene = oiio.ImageBuf(given.scene).get_pixels(oiio.FLOAT)[..., :3] if given.scene else scene
    frame, kernels = receive(given.address)
    eye = frame["eyes"][0]
    picture = post_process(scene, eye, kernels.get(eye["kernel"]), frame["display_black_share"], given.fov)
    image = oiio.ImageBuf(oiio.ImageSpec(*picture.shape[1::-1], 3, oiio.UINT8))
    if not (image.set_pixels(oiio.ROI(), picture) and image.write(given.out)):
        raise SystemExit(f"cannot write {given.out}: {image.geterror()}")
