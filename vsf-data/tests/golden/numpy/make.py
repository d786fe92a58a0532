"""Writes the fixtures of this folder with NumPy: python make.py"""
import numpy as np

values = np.array([[0.0, 1.0, 2.0], [3.0, 4.0, 5.0], [100.0, 7.0, 127.0], [9.0, 10.0, 11.0]])
for dtype in "f2 f4 f8 i1 i2 i4 i8 u1 u2 u4 u8".split():
    np.save(f"{dtype}_c.npy", values.astype(dtype))
    np.save(f"{dtype}_f.npy", np.asfortranarray(values.astype(dtype)))
np.save("special_f2.npy", np.array([-0.0, 6e-8, -65504.0, 0.1, np.inf, np.nan], dtype="f2"))
np.save("cube_f.npy", np.asfortranarray(np.arange(24.0).reshape(4, 3, 2)))
np.save("object.npy", np.array([{"a": 1}, None], dtype=object))
np.save("bool.npy", np.array([True, False, False, True]))
np.save("big_endian.npy", values.astype(">f8"))
np.save("complex.npy", values.astype("c16"))
np.save("structured.npy", np.zeros(3, dtype=[("x", "<f8"), ("y", "<i4")]))
np.save("beyond_2_53.npy", np.array([1, 2**53 + 1], dtype="i8"))
for version in (2, 3):
    with open(f"version_{version}.npy", "wb") as f:
        np.lib.format.write_array(f, values, version=(version, 0))

# OpenVSF's PointVSF.save on an archive: np.savez of points, axis_mode, features, K.
points, k = values.astype("f4"), np.array([1.0, 2.0, 3.0, 4.0], dtype="f4")
np.savez("openvsf.npz", points=points, axis_mode="isotropic", features={"K_std": k}, K=k)
np.savez("plain.npz", points=points, axis_mode="isotropic", K=k, N_obs=np.arange(4))
np.savez_compressed("compressed.npz", points=points, K=k.reshape(4, 1), K_std=k)
np.savez("axis_aligned.npz", points=points, axis_mode="axis_aligned", K=values)
np.savez("anisotropic.npz", points=points, axis_mode="anisotropic", K=np.zeros((4, 3, 3)))
